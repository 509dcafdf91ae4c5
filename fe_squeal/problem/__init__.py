"""The problem: terms that add up to M, C and K at given numbers; algebra alone."""
