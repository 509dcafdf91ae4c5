"""Decks of other programs, and bare meshes, made into scenes."""
