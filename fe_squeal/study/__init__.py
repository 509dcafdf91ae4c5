"""Studies of a problem over several numbers: scatter and maps."""
