"""Abaqus decks as scenes."""
