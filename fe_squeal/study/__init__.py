"""Studies of a problem over several numbers of its scene: scatter (probabilities) and maps of two parameters."""
