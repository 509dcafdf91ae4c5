"""One reader a format: from a file to the mesh as the file gives it."""
