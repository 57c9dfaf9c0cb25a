"""Headless OpenGL: contexts and shader programs."""
