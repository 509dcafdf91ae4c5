"""What the user sees of a run, made from arrays and tables: figures, shapes for ParaView, tables and the page."""
