"""Rays against triangles, by Embree through the optional package embreex."""
