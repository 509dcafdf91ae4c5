"""The page of a run: one file with the answer, charts, shapes that move, and what it rests on."""
