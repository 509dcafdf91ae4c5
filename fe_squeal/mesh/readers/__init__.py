"""A reader for each mesh format: it returns a `RawMesh`, the mesh as its file has it, before any check."""
