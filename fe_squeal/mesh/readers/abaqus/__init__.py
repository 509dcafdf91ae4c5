"""Abaqus input decks."""
