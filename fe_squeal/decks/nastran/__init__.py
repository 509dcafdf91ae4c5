"""Nastran decks as scenes."""
