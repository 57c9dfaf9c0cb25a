"""Methods of the source: samples in clusters, each with a sphere; their starts and their radii."""
