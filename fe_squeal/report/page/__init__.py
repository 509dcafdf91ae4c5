"""The page of a run: one HTML file with the answer, charts, moving shapes, and the evidence for the answer."""
