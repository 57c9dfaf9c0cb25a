"""Bent normals and spherical harmonics of a bake, from its visibility vectors: as arrays, and as pictures.

With the visibility vector C of a surface point, see `Integrand`: its bent normal is C / |C|, the mean direction from
which light comes, and (AO, C) are its visibility in spherical harmonics of degree 1. Pictures hold them in the space of
the scene, in those of its parts, or tangent to the surface.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.sparse import csr_array

from aoprecalc.io.meshes import part_spaces
from aoprecalc.mesh.surface import normalize
from aoprecalc.mesh.tangents import corner_tangents
from aoprecalc.options import BakeOptions, BentSpace
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import CENTER, Samples, build_layout
from aoprecalc.raster.padding import finish
from aoprecalc.types import Atlas, Baked, BoolArray, Float32Array, Int32Array, Scene, Texels

_CLOSED = 1e-4  # length of a visibility vector up to which nothing is visible: the rest of the fit of the texture
_FLAT = 1e-6  # volume of a basis of unit vectors up to which it has none
_AT_ONCE = 1 << 14  # texels whose vectors are turned at a time: they stay in the processor's cache
_REACH = 3  # texels from the surface: look-ups on it read no farther ones


def bent_normals(baked: Baked, options: BakeOptions, space: BentSpace = "world") -> Float32Array:
    """Return the bent normals of a bake that has visibility vectors, (height, width, 3) float32.

    Unit vectors, padded and filled as the AO; the shading normal where nothing is visible, 0 where nothing fills.
    """
    texture = baked.texture
    assert texture.vectors is not None
    vectors = texture.vectors.copy()
    closed = texture.known & (np.einsum("hwx,hwx->hw", vectors, vectors) <= _CLOSED**2)
    surface = TexelSurface.of(baked) if space != "world" or closed.any() else None
    if surface is not None:
        of_closed = surface.select(closed.ravel()[surface.index])
        vectors.reshape(-1, 3)[of_closed.index] = of_closed.normals()
    return normalize(_finished(baked, vectors, options, space, surface)).astype(np.float32)


def spherical_harmonics(baked: Baked, options: BakeOptions, space: BentSpace = "world") -> Float32Array:
    """Return the AO and the visibility vectors of a bake that has these, (height, width, 4) float32."""
    assert baked.texture.vectors is not None
    surface = None if space == "world" else TexelSurface.of(baked)
    vectors = _finished(baked, baked.texture.vectors, options, space, surface)
    return np.concatenate([baked.texture.values[..., None], vectors], axis=-1)


def bent_picture(baked: Baked, options: BakeOptions) -> Float32Array:
    """Return the pixels of a picture of bent normals, (height, width, 3) float32 in [-1, 1]."""
    return _with_green(bent_normals(baked, options, options.bent_space), options)


def harmonics_picture(baked: Baked, options: BakeOptions) -> Float32Array:
    """Return the pixels of a picture of spherical harmonics, (height, width, 4): the AO and the vector, see above."""
    pixels = spherical_harmonics(baked, options, options.bent_space)
    pixels[..., 1:] = _with_green(pixels[..., 1:], options)
    return pixels


def encoded(pixels: Float32Array) -> Float32Array:
    """Return pixels as pictures of integers hold them: of the last three channels, a vector, 0.5 v + 0.5."""
    pictured = pixels.copy()
    pictured[..., -3:] = np.float32(0.5) * pixels[..., -3:] + np.float32(0.5)
    return pictured


def _with_green(vectors: Float32Array, options: BakeOptions) -> Float32Array:
    """Return vectors with the second component as it is (OpenGL, glTF), or with the other sign (DirectX)."""
    return vectors if options.green == "up" else vectors * np.array((1.0, -1.0, 1.0), np.float32)


def _finished(
    baked: Baked, vectors: Float32Array, options: BakeOptions, space: BentSpace, surface: "TexelSurface | None"
) -> Float32Array:
    """Return vectors of the known texels in a space, padded and filled as the AO; `surface` for spaces but world."""
    texture = baked.texture
    if surface is not None:
        vectors = surface.turned(vectors, space)
    assert texture.padding is not None
    return finish(vectors, texture.known, texture.valid, texture.padding, options.fill)


# The spaces of vectors.


def scene_tangents(scene: Scene, atlas: Atlas, normals: Float32Array) -> Float32Array:
    """Return the tangents that viewers of a glTF use, (f, 3, 4) float32, in the space of the scene.

    They are those of the file; where it has none those of MikkTSpace, by the UVs of the normal map, else of the bake.
    """
    uvs, tangents = atlas.uvs.copy(), np.zeros((len(scene.faces), 3, 4), np.float32)
    spaces = [part_spaces(scene, part) for part in scene.parts]
    for part, space in zip(scene.parts, spaces, strict=True):
        if part.uv_owner is not None:
            uvs[part.faces] = atlas.uvs[scene.parts[part.uv_owner].faces]
        if space.normal_map_uvs is not None:
            uvs[part.faces] = space.normal_map_uvs
    for part, space in zip(scene.parts, spaces, strict=True):
        if space.tangents is not None:
            tangents[part.faces] = space.tangents
        else:
            own = part.faces
            tangents[own] = corner_tangents(scene.corners[own], normals[own], uvs[own])
    return tangents


@dataclass(frozen=True, eq=False)
class TexelSurface:
    """The surface under the known texels of a texture: at their centre, or the nearest point of it in them.

    index    (k,) int32: the texels, row * width + column
    samples  of these texels; of the nearest one where the surface covers nothing of a texel
    baked    the bake of the texture
    """

    index: Int32Array
    samples: Samples
    baked: Baked

    @classmethod
    def of(cls, baked: Baked) -> Self:
        """Find it by the rasterizer that needs no OpenGL."""
        known, repeats = baked.texture.known, baked.atlas.repeats
        height, width = known.shape
        index = np.flatnonzero(known).astype(np.int32)
        layout = build_layout(baked.scene, baked.atlas, width, height)
        samples = CPURasterizer(layout).samples(Texels(width, height, index), CENTER)
        rows: Int32Array = np.full(known.shape, -1, np.int32)
        rows.ravel()[index] = np.where(samples.faces >= 0, np.arange(len(index)), -1)
        chosen = rows.ravel()[index]
        bare = np.flatnonzero(chosen < 0)
        chosen[bare] = _nearest(rows, index[bare], repeats=repeats)
        index, chosen = index[chosen >= 0], chosen[chosen >= 0]
        return cls(index, Samples(samples.faces[chosen], samples.weights[chosen]), baked)

    def select(self, rows: slice | BoolArray) -> Self:
        """Return it for some of its texels."""
        return replace(
            self, index=self.index[rows], samples=Samples(self.samples.faces[rows], self.samples.weights[rows])
        )

    def interpolated(self, corners: Float32Array) -> Float32Array:
        """Return vectors at the corners of faces, (f, 3, ..., 3), interpolated at the texels, (k, ..., 3)."""
        columns = (3 * self.samples.faces[:, None] + np.arange(3, dtype=np.int32)).ravel()
        rows = np.arange(0, len(columns) + 1, 3, dtype=np.int32)
        matrix = csr_array((self.samples.weights.ravel(), columns, rows), shape=(len(rows) - 1, 3 * len(corners)))
        vectors: Float32Array = matrix @ corners.reshape(3 * len(corners), -1)
        return vectors.reshape(-1, *corners.shape[2:])

    def normals(self) -> Float32Array:
        """Return the shading normals at the texels, (k, 3) unit vectors."""
        return normalize(self.interpolated(self.baked.normals)).astype(np.float32)

    def turned(self, vectors: Float32Array, space: BentSpace) -> Float32Array:
        """Return an image of vectors in the space of the scene, (height, width, 3), in another; their lengths stay."""
        if space == "world":
            return vectors
        bases = _corner_bases(self.baked) if space == "tangent" else None
        flat = vectors.reshape(-1, 3)
        turned: Float32Array = np.zeros_like(flat)
        for start in range(0, len(self.index), _AT_ONCE):
            some = self.select(slice(start, start + _AT_ONCE))
            before = flat[some.index]
            after = some._in_parts(before) if bases is None else some._tangential(before, bases)
            turned[some.index] = after * _ratio(_length(before.T), _length(after.T))[:, None]
        return turned.reshape(vectors.shape)

    def _in_parts(self, vectors: Float32Array) -> Float32Array:
        """Return vectors as normals are stored: a viewer's normal matrix, the inverse transpose, gives them back."""
        faces, weights, result = self.samples.faces, self.samples.weights, vectors.copy()
        for part in self.baked.scene.parts:
            linear = part_spaces(self.baked.scene, part).linear
            own = np.flatnonzero((faces >= part.start) & (faces < part.stop))
            if linear.ndim == 2:
                result[own] = vectors[own] @ linear
            else:
                at_corners = linear[faces[own] - part.start]
                result[own] = np.einsum("kc,kx,kcxy->ky", weights[own], vectors[own], at_corners)
        return result

    def _tangential(self, vectors: Float32Array, bases: Float32Array) -> Float32Array:
        """Return the directions of vectors in the basis that viewers such as three.js use, of any length.

        Its columns are tangent, bitangent and normal, each interpolated between the corners and then normalised.
        bases   (f, 3, 3, 3): see `_corner_bases`
        """
        tangent, bitangent, normal = basis = np.ascontiguousarray(self.interpolated(bases).transpose(1, 2, 0))
        rows = _cross(bitangent, normal), _cross(normal, tangent), _cross(tangent, bitangent)
        lengths, volume = [_length(vector) for vector in basis], _dot(tangent, rows[0])
        flat = np.abs(volume) <= _FLAT * lengths[0] * lengths[1] * lengths[2]  # opposite tangents cancel: none has one
        # The coordinates are the products with the rows over the volume: only its sign tells in their direction.
        along = np.stack([_dot(row, vectors.T) * length for row, length in zip(rows, lengths, strict=True)], axis=1)
        along *= np.copysign(np.float32(1), volume)[:, None]
        along[flat] = 0, 0, 1
        return along


def _corner_bases(baked: Baked) -> Float32Array:
    """Return tangent, bitangent and normal at the corners of faces, (f, 3, 3, 3) float32."""
    normals, tangents = baked.normals, scene_tangents(baked.scene, baked.atlas, baked.normals)
    bitangents = (np.cross(normals, tangents[..., :3]) * tangents[..., 3:]).astype(np.float32)
    return np.stack([tangents[..., :3], bitangents, normals], axis=2)


def _nearest(numbers: Int32Array, texels: Int32Array, *, repeats: bool) -> Int32Array:
    """Return the number of the nearest texel within _REACH that has one, (k,); -1 where none has.

    numbers   (height, width), -1 for texels without one
    texels    (k,) row * width + column
    """
    height, width = numbers.shape
    around = np.stack(np.meshgrid(*2 * [np.arange(-_REACH, _REACH + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
    distances = (around**2).sum(axis=1)
    found = np.full(len(texels), -1, np.int32)
    for right, down in around[np.argsort(distances, kind="stable")][1 : np.count_nonzero(distances <= _REACH**2)]:
        missing = np.flatnonzero(found < 0)
        row, column = texels[missing] // width + down, texels[missing] % width + right
        inside = repeats | ((row >= 0) & (row < height) & (column >= 0) & (column < width))
        found[missing] = np.where(inside, numbers[row % height, column % width], -1)
    return found


def _cross(u: Float32Array, v: Float32Array) -> Float32Array:
    """Return the cross products of vectors, (3, k)."""
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def _dot(u: Float32Array, v: Float32Array) -> Float32Array:
    """Return the scalar products of vectors, (3, k), as (k,)."""
    product: Float32Array = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    return product


def _length(u: Float32Array) -> Float32Array:
    """Return the lengths of vectors, (3, k), as (k,)."""
    return np.sqrt(_dot(u, u))


def _ratio(a: Float32Array, b: Float32Array) -> Float32Array:
    """Return a / b; 0 where b is 0."""
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0)
