"""Eigenpairs of plain matrices, with backward errors, conditions and counts of modes."""
