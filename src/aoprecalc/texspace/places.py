"""Where samples lie in the texture, and how much surface they stand for."""

import numpy as np

from aoprecalc.model import Atlas, Doubles, Floats, Scene, Texels
from aoprecalc.surface.normals import area_vectors
from aoprecalc.surface.unit import centred
from aoprecalc.texspace.samples import Samples


def places(atlas: Atlas, texels: Texels, samples: Samples) -> Floats:
    """Return where samples lie, (k, 2) float32 texels right and down; any place for those without a face."""
    # Near the origin first: 32 bits do not resolve a texel far from it, and which repeat it is does not matter.
    uvs = atlas.uvs - np.floor(atlas.uvs.min(axis=1, keepdims=True)) if atlas.wraps else atlas.uvs
    corners = (uvs * (texels.width, -texels.height) + (0.0, texels.height)).astype(np.float32)
    # From the first corner along both sides: half the time of a sum over three corners.
    sides = corners[:, 1:] - corners[:, :1]
    where: Floats = np.take(corners[:, 0], samples.faces, axis=0)
    where += samples.weights[:, 1:2] * np.take(sides[:, 0], samples.faces, axis=0)
    where += samples.weights[:, 2:3] * np.take(sides[:, 1], samples.faces, axis=0)
    return where


def surface_of_texel(scene: Scene, atlas: Atlas, texels: Texels) -> Doubles:
    """Return the area of surface that a sample on each face stands for, (f,) float64, with the mesh in the unit sphere.

    A face of less than a texel is taken for one, as it has hardly more than one sample.
    """
    surface = np.linalg.norm(area_vectors(centred(scene.positions)[scene.faces]), axis=1) / 2
    first, second = atlas.uvs[:, 1] - atlas.uvs[:, 0], atlas.uvs[:, 2] - atlas.uvs[:, 0]
    share = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    stands_for: Doubles = surface / np.maximum(share * texels.width * texels.height, 1.0)
    return stands_for
