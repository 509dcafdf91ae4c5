"""From a scene to the folder of its results: the names of the files there, the lock, the manifest, the checkpoint."""
