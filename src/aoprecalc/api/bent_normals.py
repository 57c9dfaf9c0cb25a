"""Bent normals and spherical harmonics of a bake, from its visibility vectors.

With the visibility vector C of a surface point, see `Integrand`: its bent normal is C / |C|, the mean direction from
which light comes, and (AO, C) are its visibility in spherical harmonics of degree 1.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from aoprecalc.mesh.surface import normalize
from aoprecalc.options import BakeOptions
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, Samples, build_layout
from aoprecalc.raster.resolve import finish, pad
from aoprecalc.types import Baked, BoolArray, Float32Array, Int32Array, Texels

_CLOSED = 1e-4  # length of a visibility vector up to which nothing is visible: the rest of the fit of the texture
_REACH = 3  # texels from the surface: look-ups on it read no farther ones


def bent_normals(baked: Baked, options: BakeOptions) -> Float32Array:
    """Return the bent normals of a bake that has visibility vectors, (height, width, 3) float32.

    Unit vectors in the coordinates of the scene, padded and filled as the AO; the shading normal where nothing is
    visible, 0 where nothing fills.
    """
    texture = baked.texture
    assert texture.vectors is not None
    vectors = normalize(texture.vectors).astype(np.float32)
    closed = texture.known & (np.linalg.norm(texture.vectors, axis=-1) <= _CLOSED)
    if closed.any():
        vectors[closed] = texel_normals(baked)[closed]
    return normalize(_finish(baked, vectors, options)).astype(np.float32)


def spherical_harmonics(baked: Baked, options: BakeOptions) -> Float32Array:
    """Return the AO and the visibility vectors of a bake that has these, (height, width, 4) float32."""
    assert baked.texture.vectors is not None
    return np.concatenate([baked.texture.values[..., None], _finish(baked, baked.texture.vectors, options)], axis=-1)


DIRECTIONAL = bent_normals, spherical_harmonics  # what Python gets


@dataclass(frozen=True, eq=False)
class TexelSurface:
    """The surface under the known texels of a texture: at their centre, or the nearest point of it in them.

    known    (height, width) bool
    index    (k,) int32: those of them that the surface covers, row * width + column
    samples  of these texels
    repeats  the texture repeats
    """

    known: BoolArray
    index: Int32Array
    samples: Samples
    repeats: bool

    @classmethod
    def of(cls, baked: Baked) -> Self:
        """Find it by the rasterizer that needs no OpenGL."""
        known = baked.texture.known
        height, width = known.shape
        index = np.flatnonzero(known).astype(np.int32)
        layout = build_layout(baked.scene, baked.atlas, width, height)
        samples = CPURasterizer(layout).samples(Texels(width, height, index), CENTER)
        covered = samples.faces >= 0
        return cls(
            known, index[covered], Samples(samples.faces[covered], samples.weights[covered]), baked.atlas.repeats
        )

    def interpolated(self, corners: Float32Array) -> Float32Array:
        """Return values at the corners of faces, (f, 3, c), at the known texels, (height, width, c); 0 elsewhere.

        Where the surface covers nothing of a known texel they are those of the nearest one.
        """
        values: Float32Array = np.zeros((self.known.size, corners.shape[2]), np.float32)
        values[self.index] = np.einsum("kc,kcx->kx", self.samples.weights, corners[self.samples.faces])
        covered: BoolArray = np.zeros(self.known.size, bool)
        covered[self.index] = True
        image = values.reshape(*self.known.shape, -1)
        padded, _ = pad(image, covered.reshape(self.known.shape), _REACH, repeats=self.repeats)
        return np.where(self.known[..., None], padded, np.float32(0))


def texel_normals(baked: Baked) -> Float32Array:
    """Return the shading normals of the known texels, (height, width, 3) float32 unit vectors; 0 elsewhere."""
    return normalize(TexelSurface.of(baked).interpolated(baked.normals)).astype(np.float32)


def _finish(baked: Baked, image: Float32Array, options: BakeOptions) -> Float32Array:
    """Return an image of the known texels padded and filled as the AO."""
    texture = baked.texture
    return finish(image, texture.known, texture.valid, options.padding, options.fill, repeats=baked.atlas.repeats)


def encoded(vectors: Float32Array, *, green_up: bool = True) -> Float32Array:
    """Return (..., 3) vectors in [-1, 1] as pictures of integers hold them, in [0, 1]: 0.5 v + 0.5.

    green_up   the second component is as it is, as in OpenGL and glTF; else it has the other sign, as in DirectX
    """
    signs: Float32Array = np.array((1.0, 1.0 if green_up else -1.0, 1.0), np.float32)
    pictured: Float32Array = 0.5 * signs * vectors + np.float32(0.5)
    return pictured
