"""What every table of a scene is made of: its base, and numbers with their ranges."""
