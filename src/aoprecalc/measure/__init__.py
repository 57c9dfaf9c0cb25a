"""How far a texture is from ray tracing, as a renderer would show it."""
