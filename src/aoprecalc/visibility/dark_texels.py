"""Why texels are dark: rays from a sample of them tell what keeps the light away.

Hidden surfaces of assets made of many parts are dark, and ought to be; a mesh that is wound inside out is dark, too.
"""

import numpy as np

from aoprecalc.types import BoolArray, DarkPart, DarkTexels, Float32Array, Float64Array, Int32Array, Texels
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.gather import TexelOcclusion
from aoprecalc.visibility.rays import RAY_OFFSET, RayCaster, embreex_problem
from aoprecalc.visibility.setup import FIT_CHUNK, BakeSetup, chunks

DARK = 0.01  # ambient occlusion below which a texel is dark: depth maps let a little light through at silhouettes
_MIN_SHARE = 0.01  # of the measured texels; where fewer are dark, their causes are not looked for
_MAX_SAMPLES = 2000  # dark texels from which rays are cast: shares are good to 0.01 of the dark texels
_DIRECTIONS = 128  # on the whole sphere, from each
_OPEN_BACK = 0.05  # cosine-weighted share of the rays from the back that leave the scene, from which it faces outwards
_ON_GROUND = 1e-3  # height above the lowest point, over the bounding radius, up to which a surface rests on the ground
_MIN_PART = 0.5  # of a part's texels: parts of which less is enclosed or faces inwards are not named


def dark_texels(setup: BakeSetup, sides: list[TexelOcclusion]) -> DarkTexels:
    """Return the share of the dark texels, and what keeps the light away from them.

    The causes are found by rays from up to 2000 of the dark texels, chosen at random with a fixed seed. They are not
    looked for where less than 1% of the texels is dark, or where rays cannot be traced.
    """
    dark, measured = _dark(sides, setup.texels)
    share = len(dark) / measured
    if share < _MIN_SHARE or embreex_problem() is not None:
        return DarkTexels(share)
    chosen = dark
    if len(dark) > _MAX_SAMPLES:
        chosen = np.sort(np.random.default_rng(0).choice(dark, _MAX_SAMPLES, replace=False))
    samples = setup.center_samples(_texels(setup, chosen))
    has_face = samples.faces >= 0
    faces = samples.faces[has_face]
    if not len(faces):
        return DarkTexels(share)
    causes = _causes(setup, faces, samples.weights[has_face])
    shares = {name: share * float(found.mean()) for name, found in causes.items()}
    return DarkTexels(share, len(faces), **shares, parts=_dark_parts(setup, dark, faces, causes))


def _dark(sides: list[TexelOcclusion], texels: Texels) -> tuple[Int32Array, int]:
    """Return the index of each texel that is dark on all sides, ascending, and how many texels have a value."""
    measured, lit = (np.zeros(texels.width * texels.height, bool) for _ in range(2))
    for side in sides:
        measured[side.texels.index[side.measured]] = True
        lit[side.texels.index[side.measured & (side.values >= DARK)]] = True
    return np.flatnonzero(measured & ~lit).astype(np.int32), int(np.count_nonzero(measured))


def _texels(setup: BakeSetup, index: Int32Array) -> Texels:
    return Texels(setup.texels.width, setup.texels.height, index)


def _causes(setup: BakeSetup, faces: Int32Array, weights: Float32Array) -> dict[str, BoolArray]:
    """Return by cause which of k surface points it keeps dark, (k,) bool each; a point has one cause."""
    surface, options = setup.sides[0].surface, setup.inputs.options
    points, normals, geometric = surface.interpolate(faces, weights)
    axes = light_axes(_DIRECTIONS)
    directions = np.concatenate([axes, -axes])
    cosines = geometric @ directions.T
    origins = points[:, None] + RAY_OFFSET * np.sign(cosines)[:, :, None] * geometric[:, None]
    along = np.broadcast_to(directions, origins.shape)
    rays = [np.ascontiguousarray(ends.reshape(-1, 3), np.float32) for ends in (origins, along)]
    leaves = ~RayCaster(surface.occluders, options.threads).occluded(*rays).reshape(cosines.shape)

    def open_share(weight: Float64Array) -> Float64Array:
        shares: Float64Array = (weight * leaves).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
        return shares

    front = open_share(np.where(cosines > 0, np.maximum(normals @ directions.T, 0), 0))  # without the ground
    back = open_share(np.maximum(-cosines, 0))
    by_ground = (front >= DARK) & (surface.ground_normal is not None)
    on_ground = np.zeros(len(faces), bool)
    if surface.ground_normal is not None:
        up = np.asarray(surface.ground_normal)
        on_ground = by_ground & (points @ up <= (surface.bounding_points @ up).min() + _ON_GROUND)
    inwards = (front < DARK) & (back >= _OPEN_BACK)
    inside = ~inwards & (front == 0)
    return {
        "inside": inside,
        "inwards": inwards,
        "on_ground": on_ground,
        "above_ground": by_ground & ~on_ground,
        "narrow": ~(inside | inwards | by_ground),
    }


def _dark_parts(
    setup: BakeSetup, dark: Int32Array, sampled: Int32Array, causes: dict[str, BoolArray]
) -> tuple[DarkPart, ...]:
    """Return the parts of which at least half is enclosed, or faces inwards, those with the most such texels first.

    dark      index of each dark texel
    sampled   (k,) int32: the faces of the dark texels from which rays were cast
    causes    of these, see `_causes`
    """
    parts = setup.inputs.scene.parts
    if len(parts) == 1:
        return ()
    part_of_face = np.repeat(np.arange(len(parts)), [part.stop - part.start for part in parts])
    is_dark = np.zeros(setup.texels.width * setup.texels.height, bool)
    is_dark[dark] = True
    all_texels, dark_ones = (np.zeros(len(parts), np.int64) for _ in range(2))
    for chunk in chunks(len(setup.texels), FIT_CHUNK):
        texels = setup.texels.select(chunk)
        faces = setup.center_samples(texels).faces
        of_texel = part_of_face[faces[faces >= 0]]
        all_texels += np.bincount(of_texel, minlength=len(parts))
        dark_ones += np.bincount(of_texel[is_dark[texels.index[faces >= 0]]], minlength=len(parts))
    of_sample = part_of_face[sampled]
    per_sample = dark_ones / np.maximum(np.bincount(of_sample, minlength=len(parts)), 1)
    inside, inwards = (
        per_sample * np.bincount(of_sample, weights=causes[cause], minlength=len(parts))
        for cause in ("inside", "inwards")
    )
    totals = np.maximum(all_texels, 1)
    named = np.flatnonzero(np.maximum(inside, inwards) >= _MIN_PART * totals)
    named = named[np.argsort(-(inside + inwards)[named], kind="stable")]
    return tuple(
        DarkPart(parts[number].name, float(inside[number] / totals[number]), float(inwards[number] / totals[number]))
        for number in named[all_texels[named] > 0].tolist()
    )
