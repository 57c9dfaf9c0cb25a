"""Where samples lie in the texture, and how much surface they stand for."""

import numpy as np

from aoprecalc.model import Atlas, Doubles, Scene, Texels
from aoprecalc.surface.normals import area_vectors
from aoprecalc.texspace.samples import Samples


def places(atlas: Atlas, texels: Texels, samples: Samples) -> Doubles:
    """Return where samples lie, (k, 2) float64 texels right and down; any place for those without a face."""
    uvs = np.einsum("kc,kcx->kx", samples.weights, atlas.uvs[samples.faces])
    where: Doubles = uvs * (texels.width, -texels.height) + (0.0, texels.height)
    return where


def surface_of_texel(scene: Scene, atlas: Atlas, texels: Texels) -> Doubles:
    """Return the area of surface that a sample on each face stands for, (f,) float64 in squares of the mesh's unit.

    A face of less than a texel is taken for one, as it has hardly more than one sample.
    """
    surface = np.linalg.norm(area_vectors(scene.corners), axis=1) / 2
    first, second = atlas.uvs[:, 1] - atlas.uvs[:, 0], atlas.uvs[:, 2] - atlas.uvs[:, 0]
    share = np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    stands_for: Doubles = surface / np.maximum(share * texels.width * texels.height, 1.0)
    return stands_for
