"""How alike spheres and a mesh are: silhouettes, distances, volumes."""
