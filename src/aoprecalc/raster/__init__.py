"""Texture space: which texels the surface covers, samples in them, the least-squares image, padding."""
