"""What the user sees of a run, from arrays and tables: figures, mode shapes for ParaView, pictures and tables."""
