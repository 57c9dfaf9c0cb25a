"""Triangle meshes: vertices, normals, topology, alpha masks, sampling."""
