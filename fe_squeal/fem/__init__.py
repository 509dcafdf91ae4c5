"""Every formula of the discretisation: from meshes and materials to element matrices and contact operators."""
