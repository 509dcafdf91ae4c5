"""A reader for each format, from a file to the mesh as the file gives it."""
