"""Sweeps over a parameter: modes at every value, branches, onsets, and checks that none of these is missing."""
