"""Visibility of light directions: depth maps, rays, and the estimate made of them.

*Précalcul*: the French report that this software implements (sections 1.1, ambient occlusion, and 1.2, spheres).
Section 1.1 is here.
"""
