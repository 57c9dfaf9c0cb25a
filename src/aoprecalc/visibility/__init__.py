"""Visibility of light directions: depth maps, rays, and the estimate made of them."""
