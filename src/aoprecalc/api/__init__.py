"""The jobs as a whole, each the story of one job in a screenful: bake, spheres, verify, compare, doctor."""
