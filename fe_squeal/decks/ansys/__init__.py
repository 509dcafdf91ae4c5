"""Ansys archives as scenes."""
