"""Sparse direct solvers, a file each, behind the protocol of `factor`, and the choice among them."""
