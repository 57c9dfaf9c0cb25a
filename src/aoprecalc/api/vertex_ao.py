"""Ambient occlusion at the vertices of a bake: fitted to its texture, and how near it comes to that."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aoprecalc.io.formats.textures import shared_by_owners
from aoprecalc.mesh.surface import SurfacePoints, area_vectors, sample_surface, to_unit_sphere
from aoprecalc.mesh.vertex_values import fit_vertex_values, vertex_groups
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import VerifyOptions
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Baked, BoolArray, Float32Array, Float64Array, Scene

_POINTS_PER_TEXEL = 2.0  # at which the texture is asked


def fit_to_texture(baked: Baked) -> Float32Array:
    """Return the values at the corners, (f, 3) float32 in [0, 1], that come nearest to the texture of a bake.

    Corners of one position and shading normal have one value, also on both sides of a UV seam. Parts that share texels
    have the values of the part that owns them; those that are not baked have 1.
    """
    scene, atlas = baked.scene, baked.atlas
    faces = np.flatnonzero(_own_values(scene))
    groups = np.unique(vertex_groups(scene, baked.normals)[faces], return_inverse=True)[1].reshape(-1, 3)
    corners = to_unit_sphere(scene.positions)[scene.faces[faces]]
    points = _POINTS_PER_TEXEL * doubled_uv_areas(atlas.uvs[faces]) / 2 * baked.texture.values.size
    values = fit_vertex_values(
        corners,
        groups,
        np.linalg.norm(area_vectors(corners), axis=1) * atlas.mapped[faces],
        points,
        lambda places: _texture_at(baked, SurfacePoints(faces[places.faces], places.weights)),
    )
    result = np.ones((len(scene.faces), 3, 1), np.float32)
    result[faces, :, 0] = values[groups]
    return shared_by_owners(scene, result)[:, :, 0]


def _own_values(scene: Scene) -> BoolArray:
    """Return the faces that are baked and share no texels of another part, (f,) bool."""
    return scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)


@dataclass(frozen=True)
class VertexErrors:
    """How near the values at vertices, interpolated over the faces, come to the texture and to ray tracing.

    vertices   number of positions with one shading normal that have a value
    rmse       root mean square of the difference from the texture, at points uniform on the surface
    traced     that from ray tracing; None where no rays were cast
    """

    vertices: int
    rmse: float
    traced: float | None


def vertex_errors(baked: Baked, verified: TextureErrors | None) -> VertexErrors | None:
    """Measure the values at the vertices of a bake, at the points of `verify`; None where it has none.

    verified   the errors of the texture, as `measure_texture` finds them with the default points and seed
    """
    if baked.vertex_ao is None:
        return None
    scene, how = baked.scene, VerifyOptions()
    points = sample_surface(scene, baked.atlas.mapped, how.points, how.seed)
    traced = None
    if verified is not None:
        traced = interpolation_error(baked.vertex_ao, points.select(verified.hit), verified.reference)
    vertices = len(np.unique(vertex_groups(scene, baked.normals)[_own_values(scene)]))
    return VertexErrors(
        vertices,
        interpolation_error(baked.vertex_ao, points, _texture_at(baked, points)),
        traced,
    )


def interpolation_error(values: NDArray[np.floating], points: SurfacePoints, expected: Float64Array) -> float:
    """Return the root mean square of interpolated values, (f, 3) at the corners, minus those expected at k points."""
    interpolated = points.interpolate(values[:, :, None])[:, 0]
    return float(np.sqrt(np.mean((interpolated - expected) ** 2)))


def _texture_at(baked: Baked, points: SurfacePoints) -> Float64Array:
    """Return the AO of the texture at points, (k,)."""
    uvs = points.interpolate(baked.atlas.uvs)
    return bilinear(baked.texture.values, uvs, repeats=baked.atlas.repeats)
