"""The shading of previews: clay or base colours in the light of a sky and a soft key light; linear RGB throughout."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.opaque_triangles import opaque_pieces
from aoprecalc.render.camera import Camera, PictureFrame
from aoprecalc.render.shadow import AreaLight
from aoprecalc.render.visible_surface import Fragments
from aoprecalc.texture_lookup import bilinear_taps, linear_from_srgb, mip_chain
from aoprecalc.types import (
    BaseColor,
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    Scene,
    TexturedMesh,
    UInt8Array,
)

CLAY = np.array([0.66, 0.635, 0.60], np.float32)
SPHERE = np.array([0.24, 0.42, 0.64], np.float32)
WHITE = np.float32(0.74)  # multiplies base colours, so that white in full light is white
INSIDE = np.array([0.62, 0.50, 0.44], np.float32)  # multiplies the colour of back faces
SKY, BOUNCE = np.array([0.76, 0.79, 0.84], np.float32), np.array([0.35, 0.33, 0.31], np.float32)
KEY = np.array([0.60, 0.57, 0.51], np.float32)
_MAX_LEVELS = 8  # of mip maps
_MAX_PIECES = 300_000  # into which faces with an alpha mask are cut


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles that are drawn: faces of a mesh, without the holes of alpha masks.

    corners   (o, 3, 3) float32, o >= 1
    face_of   (o,) int32: the face of each
    """

    corners: Float32Array
    face_of: Int32Array


@dataclass(frozen=True, eq=False)
class PictureMesh:
    """A mesh as pictures draw it, in the picture's frame.

    source    the mesh
    corners   (f, 3, 3) float64
    normals   (f, 3, 3) float32: unit shading normals
    inverted  (f,) bool: the shading normals oppose the winding, so that its other side is the front
    other     (f,) int64: the face of the same corners that faces the other way, of a sheet with two; else itself
    opaque    the pieces of all parts but those of glass; those of glass where there are no others
    glass     the pieces of parts that light passes through; None where there are none, or nothing else
    """

    source: TexturedMesh
    corners: Float64Array
    normals: Float32Array
    inverted: BoolArray
    other: Int64Array
    opaque: Pieces
    glass: Pieces | None

    @classmethod
    def from_mesh(cls, mesh: TexturedMesh, frame: PictureFrame) -> Self:
        """Transform a mesh and cut out its holes."""
        scene = mesh.scene
        corners = frame.points(scene.positions)[scene.faces]
        normals = frame.vectors(mesh.normals)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).astype(np.float32)
        inverted = (np.einsum("fcx,fx->fc", normals, across) < 0).all(axis=1)
        clear = scene.per_face(part.material.transparent for part in scene.parts)
        if clear.all():
            clear[:] = False
        opaque = _pieces(scene, corners, ~clear, frame)
        glass = _pieces(scene, corners, clear, frame) if clear.any() else None
        return cls(mesh, corners, normals, inverted, _opposite_faces(scene.faces, across), opaque, glass)

    @cached_property
    def mips(self) -> list[Float32Array]:
        """The mip levels of the texture."""
        assert self.source.ao is not None
        return mip_chain(self.source.ao, _MAX_LEVELS)

    @cached_property
    def _base_textures(self) -> dict[tuple[int, int], Float32Array]:
        return {}

    def base_texture(self, base: BaseColor, level: int) -> Float32Array:
        """Return a mip level of a base colour's texture, linear, (h, w, 3) float32."""
        assert base.texture is not None
        step = 1 << min(level, min(base.texture.shape[:2]).bit_length() - 1)
        key = id(base.texture), step
        if key not in self._base_textures:
            height, width = (side // step for side in base.texture.shape[:2])
            blocks = decode(base.texture[: height * step, : width * step]).reshape(height, step, width, step, 3)
            self._base_textures[key] = blocks.mean(axis=(1, 3))
        return self._base_textures[key]


def _opposite_faces(faces: Int32Array, across: Float32Array) -> Int64Array:
    """Return for each face the one of the same corners that faces the other way, else itself; (f,) of (f, 3).

    Faces have the same corners where the sums of random numbers, one for each vertex, are equal.
    """
    marks = np.random.default_rng(0).integers(0, 1 << 62, int(faces.max()) + 1, np.uint64)
    sums = marks[faces].sum(axis=1)
    order = np.argsort(sums, kind="stable")
    first, second = order[:-1], order[1:]
    opposed = (sums[first] == sums[second]) & (np.einsum("fx,fx->f", across[first], across[second]) < 0)
    other = np.arange(len(faces))
    other[first[opposed]], other[second[opposed]] = second[opposed], first[opposed]
    return other


def _pieces(scene: Scene, corners: Float64Array, chosen: BoolArray, frame: PictureFrame) -> Pieces:
    """Return the pieces of (f,) chosen faces, whose parts are chosen as a whole."""
    parts = tuple(replace(part, occludes=bool(chosen[part.faces].all())) for part in scene.parts)
    if any(part.occludes and part.material.alpha_mask is not None for part in parts):
        cut, faces = opaque_pieces(replace(scene, parts=parts), _MAX_PIECES)
        if not len(cut):  # nothing but holes: a triangle without area
            cut, faces = np.zeros((1, 3, 3)), np.zeros(1, np.int64)
        return Pieces(frame.points(cut).astype(np.float32), faces.astype(np.int32))
    faces = np.flatnonzero(chosen)
    return Pieces(corners[faces].astype(np.float32), faces.astype(np.int32))


def irradiance(normals: Float32Array, light: AreaLight) -> tuple[Float32Array, Float32Array]:
    """Return the light of the sky and of the key light on surfaces with unit normals, (m, 3); (m, 3) each.

    The sky is brighter above than the ground below: its light is linear in the normal's height. A round light of
    angular radius r reaches surfaces up to r beyond the plane through its centre.
    """
    upward = 0.5 + 0.5 * normals[:, 1:2]
    ambient = SKY * upward + BOUNCE * (1 - upward)
    cosine = normals @ np.array(light.direction, np.float32)
    wrap = np.float32(np.sin(light.radius))
    key = np.where(cosine > wrap, cosine, np.maximum(cosine + wrap, 0) ** 2 / (4 * wrap))
    return ambient, KEY * key[:, None]


def shade(
    mesh: PictureMesh, seen: Fragments, camera: Camera, light: AreaLight, shading: str
) -> tuple[Float32Array, Float32Array]:
    """Return the linear colours, (m, 3) float32, and the depths along the view, (m,) float32, of m fragments."""
    faces, local = _distinct(seen.index, len(mesh.corners))
    turned = np.where(_seen_from_behind(mesh, faces, camera), mesh.other[faces], faces)  # either was the nearest
    faces, local = _distinct(turned[local], len(mesh.corners))
    corners = mesh.corners[faces] - camera.eye
    weights = _barycentric(corners, local, camera.rays(seen.x, seen.y + camera.rows[0]))
    back = _seen_from_behind(mesh, faces, camera)
    normals = _interpolate(mesh.normals[faces], local, weights)
    normals /= np.maximum(np.sqrt(np.einsum("mx,mx->m", normals, normals)), 1e-12)[:, None]
    back = back[local]
    normals[back] *= -1
    ambient, key = irradiance(normals, light)
    projected = camera.project(mesh.corners[faces])
    if shading != "clay" and mesh.source.ao is not None and mesh.source.uvs is not None:
        uvs = mesh.source.uvs[faces]
        level = _texture_level(uvs, mesh.source.ao.shape, projected)
        occlusion = _trilinear(mesh.mips, _interpolate(uvs, local, weights), level[local])
        if mesh.source.strengths is not None:
            occlusion = 1 + mesh.source.strengths[faces][local] * (occlusion - 1)
        occlusion[~mesh.source.textured[faces][local]] = 1
        ambient *= occlusion[:, None]
        key *= self_shadow(occlusion, normals @ np.array(light.direction, np.float32))[:, None]
    color = np.broadcast_to(CLAY, ambient.shape)
    if shading == "material" and mesh.source.base_colors:
        color = WHITE * _base_colors(mesh, faces, local, weights, projected)
    linear: Float32Array = color * (ambient + key)
    linear[back] *= INSIDE
    depth = _interpolate(-(corners @ camera.axes[2])[..., None], local, weights)[:, 0]
    return linear, depth


def _seen_from_behind(mesh: PictureMesh, faces: Int64Array, camera: Camera) -> BoolArray:
    """Return which of (v,) faces show their backs."""
    corners = mesh.corners[faces] - camera.eye
    return (_determinants(corners) > 0) ^ mesh.inverted[faces]


def self_shadow(occlusion: Float32Array, cosine: Float32Array) -> Float32Array:
    """Return the share of a light that the mesh's own shadow leaves, (m,): a guess from the AO and the light's cosine.

    Of a light along the normal as much is left as the AO says, of one along the surface its cube. "Micro shadows" have
    the same aim, and a sharper edge (W. Brinck, A. Maximov, "The Technical Art of Uncharted 4", SIGGRAPH 2016).
    """
    seen: Float32Array = occlusion ** (3 - 2 * np.maximum(cosine, 0))
    return seen


def shade_spheres(
    centers: Float64Array, radii: Float64Array, seen: Fragments, camera: Camera, light: AreaLight
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """Return the linear colours of m fragments, (m, 3) float32, their depths and their cosines to the view, (m,)."""
    rays = camera.rays(seen.x, seen.y + camera.rows[0])
    towards = (centers - camera.eye).astype(np.float32)[seen.index]
    a, b = (np.einsum("mx,mx->m", rays, other) for other in (rays, towards))
    closest = (b / a)[:, None] * rays - towards
    inside = radii.astype(np.float32)[seen.index] ** 2 - np.einsum("mx,mx->m", closest, closest)
    depth: Float32Array = (b - np.sqrt(np.maximum(inside, 0) * a)) / a
    normals = depth[:, None] * rays - towards
    normals /= np.maximum(np.sqrt(np.einsum("mx,mx->m", normals, normals)), 1e-12)[:, None]
    ambient, key = irradiance(normals, light)
    facing = -np.einsum("mx,mx->m", normals, rays) / np.sqrt(a)
    return SPHERE * (ambient + key), depth, facing


def encode(linear: Float32Array) -> UInt8Array:
    """Return linear values as sRGB bytes (IEC 61966-2-1)."""
    steps = 4096
    table = np.arange(steps + 1) / steps
    table = np.where(table < 0.0031308, 12.92 * table, 1.055 * np.maximum(table, 1e-9) ** (1 / 2.4) - 0.055)
    at = np.clip(linear, 0, 1) * np.float32(steps)
    low = np.minimum(at.astype(np.int32), steps - 1)
    values = table.astype(np.float32)
    mixed = values[low] + (values[low + 1] - values[low]) * (at - low)
    bytes_: UInt8Array = (255 * mixed + 0.5).astype(np.uint8)
    return bytes_


def decode(values: UInt8Array) -> Float32Array:
    """Return sRGB bytes as linear values."""
    linear: Float32Array = linear_from_srgb(np.arange(256) / 255)[values]
    return linear


def _distinct(index: NDArray[np.int32], count: int) -> tuple[Int64Array, Int64Array]:
    """Return the distinct values of (m,) indices below count, and which of them each is."""
    seen = np.zeros(count, bool)
    seen[index] = True
    return np.flatnonzero(seen), (np.cumsum(seen) - 1)[index]


def _determinants(corners: Float64Array) -> Float64Array:
    """Return the determinants of triangles' corners, (v,) of (v, 3, 3): positive where the origin is behind."""
    determinants: Float64Array = np.einsum("vx,vx->v", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return determinants


def _barycentric(corners: Float64Array, local: Int64Array, rays: Float32Array) -> Float32Array:
    """Return the weights of the corners of triangles, (m, 3), where rays from the origin meet them.

    The weight of a corner is as the volume of the parallelepiped of the ray and the two others
    (T. Moeller, B. Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997).
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    scale = np.abs(volumes).max(axis=(1, 2), keepdims=True)
    scaled = (volumes / np.where(scale > 0, scale, 1)).astype(np.float32)
    weights = np.einsum("mcx,mx->mc", scaled[local], rays)
    weights *= np.where(_determinants(corners) < 0, np.float32(-1), np.float32(1))[local][:, None]
    np.maximum(weights, 0, out=weights)
    total = weights.sum(axis=1, keepdims=True)
    return np.where(total > 0, weights / np.where(total > 0, total, 1), np.float32(1 / 3))


def _interpolate(values: NDArray[np.floating], local: Int64Array, weights: Float32Array) -> Float32Array:
    """Interpolate values at corners, (v, 3, x); returns (m, x) float32."""
    values = values.astype(np.float32)
    mixed: Float32Array = sum(weights[:, k : k + 1] * values[local, k] for k in range(3))
    return mixed


def _texture_level(uvs: Float64Array, shape: tuple[int, ...], projected: Float64Array) -> Float32Array:
    """Return the mip level at which a texel is as large as a pixel, by triangle, (v,), as OpenGL chooses it."""
    texels = uvs * np.array([shape[1], shape[0]])
    (ux, uy), (vx, vy) = ((texels[:, k] - texels[:, 0]).T for k in (1, 2))
    (px, py), (qx, qy) = ((projected[:, k, :2] - projected[:, 0, :2]).T for k in (1, 2))
    area = px * qy - py * qx
    area = np.where(np.abs(area) > 1e-9, area, 1e-9)
    across = np.hypot(ux * qy - vx * py, uy * qy - vy * py) / np.abs(area)
    down = np.hypot(vx * px - ux * qx, vy * px - uy * qx) / np.abs(area)
    level: Float32Array = (
        np.log2(np.maximum(np.maximum(across, down), 1e-6)).clip(0, _MAX_LEVELS - 1).astype(np.float32)
    )
    return level


def _trilinear(mips: list[Float32Array], uvs: Float32Array, level: Float32Array) -> Float32Array:
    """Look (m, 2) UVs up between the mip levels of (m,) level."""
    level = np.minimum(level, len(mips) - 1)
    whole = level.astype(np.int64)
    part = level - whole
    values = np.zeros(len(uvs), np.float32)
    for number, image in enumerate(mips):
        for chosen, share in ((whole == number, 1 - part), ((whole == number - 1) & (part > 0), part)):
            index = np.flatnonzero(chosen)
            if len(index):
                values[index] += share[index] * _bilinear(image[..., None], uvs[index])[:, 0]
    return values


def _bilinear(image: Float32Array, uvs: Float32Array) -> Float32Array:
    """Look (m, 2) UVs up in an image, (h, w, c), that repeats; returns (m, c) float32."""
    height, width, channels = image.shape
    left, right, across = bilinear_taps(uvs[:, 0] * width, width, "repeat")
    above, below, down = bilinear_taps((1 - uvs[:, 1]) * height, height, "repeat")
    across, down = across[:, None], down[:, None]
    texels = image.reshape(-1, channels)
    upper = texels[above * width + left] * (1 - across) + texels[above * width + right] * across
    lower = texels[below * width + left] * (1 - across) + texels[below * width + right] * across
    values: Float32Array = upper * (1 - down) + lower * down
    return values


def _base_colors(
    mesh: PictureMesh, faces: Int64Array, local: Int64Array, weights: Float32Array, projected: Float64Array
) -> Float32Array:
    """Return the base colours of fragments, (m, 3), each texture at the mip level that suits half of its triangles."""
    color = np.empty((len(local), 3), np.float32)
    for part, base in zip(mesh.source.scene.parts, mesh.source.base_colors, strict=True):
        low, high = np.searchsorted(faces, [part.start, part.stop])
        index = np.flatnonzero((local >= low) & (local < high))
        color[index] = np.array(base.factor, np.float32)
        if len(index) and base.texture is not None and base.uvs is not None:
            corners = base.uvs[faces[low:high] - part.start]
            level = float(np.median(_texture_level(corners, base.texture.shape, projected[low:high])))
            uvs = _interpolate(corners, local[index] - low, weights[index])
            color[index] *= _bilinear(mesh.base_texture(base, round(level)), uvs)
        if len(index) and base.corners is not None:
            color[index] *= _interpolate(base.corners[faces[low:high] - part.start], local[index] - low, weights[index])
    return color
