"""From a scene to the folder of its results: one owner of its names, its lock and its checkpoint."""
