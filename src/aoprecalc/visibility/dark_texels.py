"""A first look at an atlas, before its charts are packed; and why texels are dark, after the bake.

Rays from a sample of the dark texels tell what keeps the light away.
Hidden surfaces of assets made of many parts are dark, and ought to be; a mesh that is wound inside out is dark, too.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.normalized_surface import NormalizedSurface
from aoprecalc.mesh.roles import without_surroundings
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Progress
from aoprecalc.types import (
    Atlas,
    BoolArray,
    DarkPart,
    DarkTexels,
    Float32Array,
    Float64Array,
    Int32Array,
    Scene,
    Texels,
)
from aoprecalc.visibility.backend import Backend, RayBackend
from aoprecalc.visibility.directions import MIN_SHADOW_SIZE, light_axes
from aoprecalc.visibility.gather import TexelOcclusion
from aoprecalc.visibility.ray_testers import RAY_OFFSET
from aoprecalc.visibility.rays import RayCaster, embreex_problem
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import LocalVisibility, TexelRequest

_LOOK_SIZE, _LOOK_DIRECTIONS = 256, 64  # twice as many each lower the error by less than 1%

DARK = 0.01  # ambient occlusion below which a texel is dark: depth maps let a little light through at silhouettes
_MIN_SHARE = 0.01  # of the measured texels; where fewer are dark, their causes are not looked for
_MAX_SAMPLES = 1000  # dark texels from which rays are cast: the standard error of their shares is at most 0.016
_MAX_TEXELS = 1 << 15  # from which the texels of each part are estimated
_MIN_SAMPLES = 10  # of a part, of either kind: parts with fewer are not named
_DIRECTIONS = 128  # on the whole sphere, from each
_OPEN_BACK = 0.05  # cosine-weighted share of the rays from the back that leave the scene, from which it faces outwards
_ON_GROUND = 1e-3  # height above or below the ground, over the bounding radius, up to which a surface rests on it
_MIN_PART = 0.5  # of a part's texels: parts of which less is enclosed or faces inwards are not named


def dark_texels(setup: BakeSetup, sides: Sequence[TexelOcclusion]) -> DarkTexels:
    """Return the share of the dark texels, and what keeps the light away from them.

    The causes are found by rays from up to 1000 of the dark texels, chosen at random with a fixed seed. They are not
    looked for where less than 1% of the texels is dark, or where rays cannot be traced.
    """
    dark, measured = _dark(sides, setup.texels)
    share = len(dark) / max(measured, 1)
    if share < _MIN_SHARE or embreex_problem() is not None:
        return DarkTexels(share)
    texels, scene = setup.texels, setup.inputs.scene
    chosen = _some(dark, _MAX_SAMPLES)
    others = _some(np.sort(texels.index), _MAX_TEXELS) if len(scene.parts) > 1 else chosen
    index = np.union1d(chosen, others)
    samples = setup.center_samples(Texels(texels.width, texels.height, index))
    points = setup.measured(setup.sides[0], samples)  # the rays meet what the finest level of detail shows
    cast, counted = ((points.faces >= 0) & np.isin(index, ones) for ones in (chosen, others))
    if not cast.any():
        return DarkTexels(share)
    causes = _causes(setup, points.faces[cast], points.weights[cast])
    shares = {name: share * float(found.mean()) for name, found in causes.items()}
    parts = _dark_parts(scene, samples.faces[counted], np.isin(index[counted], dark), samples.faces[cast], causes)
    return DarkTexels(share, int(np.count_nonzero(cast)), **shares, parts=parts)


def _dark(sides: Sequence[TexelOcclusion], texels: Texels) -> tuple[Int32Array, int]:
    """Return the index of each texel that is dark on all sides, ascending, and how many texels have a value."""
    measured, lit = (np.zeros(texels.width * texels.height, bool) for _ in range(2))
    for side in sides:
        measured[side.texels.index[side.measured]] = True
        lit[side.texels.index[side.measured & (side.values >= DARK)]] = True
    return np.flatnonzero(measured & ~lit).astype(np.int32), int(np.count_nonzero(measured))


def _some(index: Int32Array, count: int) -> Int32Array:
    """Return `count` of the ascending indices, ascending, chosen at random; all where there are fewer."""
    return np.sort(np.random.default_rng(0).choice(index, count, replace=False)) if len(index) > count else index


def _causes(setup: BakeSetup, faces: Int32Array, weights: Float32Array) -> dict[str, BoolArray]:
    """Return by cause which of k surface points it keeps dark, (k,) bool each; a point has one cause."""
    surfaces, threads = setup.sides[0].surfaces, setup.inputs.options.threads
    seen = [_open_shares(surface, faces, weights, threads) for surface in surfaces]
    front, back = (np.mean(shares, axis=0) for shares in list(zip(*seen, strict=True))[:2])
    height = np.max([heights for _, _, heights in seen], axis=0)
    by_ground = (front >= DARK) & (surfaces[0].ground_normal is not None)
    below_ground, above_ground = by_ground & (height < -_ON_GROUND), by_ground & (height > _ON_GROUND)
    inwards = (front < DARK) & (back >= _OPEN_BACK)
    inside = ~inwards & (front == 0)
    return {
        "inside": inside,
        "inwards": inwards,
        "below_ground": below_ground,
        "on_ground": by_ground & ~below_ground & ~above_ground,
        "above_ground": above_ground,
        "narrow": ~(inside | inwards | by_ground),
    }


def _open_shares(
    surface: NormalizedSurface, faces: Int32Array, weights: Float32Array, threads: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return how open k surface points are to the front and to the back without the ground, and how high over it."""
    front, back, height = np.zeros((3, len(faces)))
    for own, rows, own_faces in surface.by_group(faces):
        front[rows], back[rows], height[rows] = _open_to(own, own_faces, weights[rows], threads)
    return front, back, height


def _open_to(
    surface: NormalizedSurface, faces: NDArray[np.integer], weights: Float32Array, threads: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return what `_open_shares` does, for points that all of the surface may occlude."""
    points, normals, geometric = surface.interpolate(faces, weights)
    axes = light_axes(_DIRECTIONS)
    directions = np.concatenate([axes, -axes])
    cosines = geometric @ directions.T
    origins = points[:, None] + RAY_OFFSET * np.sign(cosines)[:, :, None] * geometric[:, None]
    along = np.broadcast_to(directions, origins.shape)
    rays = [np.ascontiguousarray(ends.reshape(-1, 3), np.float32) for ends in (origins, along)]
    leaves = ~RayCaster(surface.occluders, threads, surface.one_sided).occluded(rays[0], rays[1]).reshape(cosines.shape)

    def open_share(weight: Float64Array) -> Float64Array:
        shares: Float64Array = (weight * leaves).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
        return shares

    height = points @ np.asarray(surface.ground_normal or (0.0, 0.0, 0.0)) - surface.ground_height
    front = open_share(np.where(cosines > 0, np.maximum(normals @ directions.T, 0), 0))
    return front, open_share(np.maximum(-cosines, 0)), height


def _dark_parts(
    scene: Scene, faces: Int32Array, dark: BoolArray, cast: Int32Array, causes: dict[str, BoolArray]
) -> tuple[DarkPart, ...]:
    """Return the parts of which at least half is enclosed, or faces inwards, those with the most such texels first.

    faces   (k,) int32: the faces of a sample of all texels, of which those in `dark`, (k,) bool, are dark
    cast    (m,) int32: the faces of the dark texels from which rays were cast; `causes` are of these, see `_causes`
    """
    count = len(scene.parts)
    if count == 1:
        return ()
    part_of_face = np.repeat(np.arange(count), [part.stop - part.start for part in scene.parts])
    totals, dark_ones, rays, inside, inwards = (
        np.bincount(part_of_face[of], minlength=count)
        for of in (faces, faces[dark], cast, cast[causes["inside"]], cast[causes["inwards"]])
    )
    per_ray = dark_ones / np.maximum(totals * rays, 1)  # share of a part's texels that each of its rays stands for
    inside, inwards = inside * per_ray, inwards * per_ray
    known = np.minimum(totals, rays) >= _MIN_SAMPLES
    named = np.flatnonzero(known & (np.maximum(inside, inwards) >= _MIN_PART))
    named = named[np.argsort(-((inside + inwards) * totals)[named], kind="stable")]
    return tuple(DarkPart(scene.parts[number].name, float(inside[number]), float(inwards[number])) for number in named)


def first_look(
    backend: Backend, scene: Scene, normals: Float32Array, options: BakeOptions, atlas: Atlas
) -> tuple[Int32Array, Float32Array]:
    """Measure an atlas coarsely, from the front: the face at each texel or -1, and its ambient occlusion, (h, w) each.

    The same for both backends where rays can be traced, in the rest pose, without the ground and the surroundings, so
    that bakes with other options have the same UVs, and can be compared.
    """
    coarse = replace(
        options,
        size=_LOOK_SIZE,
        directions=_LOOK_DIRECTIONS,
        sampling="fibonacci",
        target_error=None,
        max_error=None,
        memory_limit=None,
        estimator="ratio",
        max_distance=None,
        falloff="none",
        cone=180,
        weight="cosine",
        sky="uniform",
        up="auto",
        ground=False,
        ground_height=None,
        bent_normals=False,
    )
    if embreex_problem() is None:
        backend = RayBackend(options.threads)
    setup = BakeSetup(backend, BakeInputs(_front_only(scene), atlas, normals, coarse))
    faces: Int32Array = np.full((_LOOK_SIZE, _LOOK_SIZE), -1, np.int32)
    values: Float32Array = np.zeros(faces.shape, np.float32)
    for side in setup.sides:  # the front in each pass
        if not (count := len(side.texels)):
            continue
        samples = setup.texel_samples(side, slice(0, count), 0)
        visibility = LocalVisibility(setup, side, MIN_SHADOW_SIZE, count, Progress())
        sums = visibility.visibility_sums(setup.measured(side, samples), TexelRequest(0, slice(0, count)))
        found, measured = setup.integrand.estimate(sums, _LOOK_DIRECTIONS)
        index = side.texels.index[measured]
        faces.ravel()[index], values.ravel()[index] = samples.faces[measured], found[measured]
    return faces, values


def _front_only(scene: Scene) -> Scene:
    """Return a scene alone in its rest pose, all of whose parts occlude and have one side; its detail too."""
    parts = tuple(replace(part, two_sided=False, self_occluded=None) for part in scene.parts)
    detail = detail_of(scene)
    front = None if detail is None else replace(detail, scene=_front_only(detail.scene))
    return replace(without_surroundings(scene), parts=parts, poses={}, detail=front)
