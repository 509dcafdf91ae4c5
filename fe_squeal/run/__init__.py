"""From a scene to a folder of results: what the commands do, the names of files, the lock, manifest and checkpoint."""
