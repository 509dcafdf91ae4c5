"""Being here, this file makes pytest put the folder `tests` on sys.path, so that tests can `import meshes`."""
