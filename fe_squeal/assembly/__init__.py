"""From a scene on its mesh to the problem."""
