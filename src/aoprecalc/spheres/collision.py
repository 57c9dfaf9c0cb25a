"""A surface in pieces so small that spheres can hold each of them whole."""

import numpy as np
from scipy.spatial import cKDTree

from aoprecalc.mesh.topology import topology
from aoprecalc.progress import Progress
from aoprecalc.spheres.fitted import SphereFit
from aoprecalc.spheres.sampling import NormalizedFrame
from aoprecalc.spheres.shadow import VIEWS_PER_STEP, SilhouetteTarget, fit_shadow
from aoprecalc.spheres.silhouette_descent import SilhouetteDescent
from aoprecalc.spheres.voxels import VoxelGrid, inside_mesh
from aoprecalc.types import Float64Array, Int64Array, Scene


def subdivide(corners: Float64Array, longest: float) -> Float64Array:
    """Halve the longest side of triangles, (f, 3, 3), until none is longer than `longest` > 0; returns (m, 3, 3).

    The pieces cover the triangles exactly, but for the rounding of the middles of sides.
    """
    small = []
    while len(corners):
        lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        small.append(corners[lengths.max(axis=1) <= longest])
        large = lengths.max(axis=1) > longest
        first = lengths[large].argmax(axis=1)[:, None] + np.arange(
            3
        )  # the longest side runs from the first to the second
        a, b, c = np.take_along_axis(corners[large], first[..., None] % 3, axis=1).transpose(1, 0, 2)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack(of, axis=1) for of in ((a, middle, c), (middle, b, c))])
    return np.concatenate(small)


# Spheres that hold the whole surface, and the inside of a closed mesh, while they protrude little.
#
# They begin as those of `shadow`. The same descent goes on, with a pull on the nearest sphere from each point that none
# holds, until hardly any is left outside. Then each piece of the surface is given to its nearest sphere, and every
# sphere grows until it holds its pieces' corners: as balls are convex it holds the pieces, and so together the spheres
# hold every point of the surface, not of samples alone.

# Chosen on bunny, bigguy, ogre and fruit fly.
_STEPS = 300
_PULL = 4.0  # in the end, of a point against the silhouettes' share of it
_DRAWN = 4000  # points that pull in a step
# Pixels: how far inside a sphere a point still pulls, and how far outside its pull stops growing.
_SLACK, _STRONGEST = 0.3, 3.0
_PIECE = 0.03  # longest side of a piece, in the frame
_CUBES = 48  # along the longest side of the grid whose points inside the mesh are held
_FEW = 256  # spheres that are all measured; measured: of 100 in a fifth of the time that a look-up takes
_MOVES = 8  # times that spheres without pieces are moved
_LISTED = 16  # centres that are looked up where there are more
_BLOCK = 1 << 16  # values measured at a time: they stay in cache, and a product of so few starts no threads
_ROUNDING = 1e-12  # in the frame, by which spheres are larger than what they hold


def fit_collision(
    scene: Scene, frame: NormalizedFrame, points: Float64Array, count: int, rng: np.random.Generator, progress: Progress
) -> SphereFit:
    """Fit `count` spheres that hold the surface of a scene, to within the rounding of coordinates.

    points   (s, 3) float64 samples of its surface in the frame
    Of the inside of a watertight mesh the points of a grid are held, 48 along the longest side of its box.
    """
    target = SilhouetteTarget.of(scene, frame)
    begun = fit_shadow(scene, frame, target, points, count, rng, progress)
    small = subdivide(frame.to_normalized(scene.corners), _PIECE)
    held = np.concatenate([small.reshape(-1, 3), _inside(scene, frame)])
    descent = SilhouetteDescent(begun.centers, begun.radii, target.wanted, target.seen, VIEWS_PER_STEP)
    for step in range(_STEPS):
        share = step / _STEPS
        some = held[rng.integers(len(held), size=_DRAWN)]
        strength = _PULL * (0.1 + 3 * share) * target.wanted.sum() / len(target.seen) / _DRAWN
        pull = _pull(some, descent.centers, descent.radii, target.seen.scale, strength)
        descent.step(0.5 * (1 - share) + 0.03, pull)
        progress.advance()
    centers, radii = _employed(small, descent.centers, descent.radii)
    radii = _grown(small, held[small.size // 3 :], centers, radii)
    return SphereFit(centers, radii, begun.iterations + _STEPS, converged=True)


def _pull(
    points: Float64Array, centers: Float64Array, radii: Float64Array, scale: float, strength: float
) -> Float64Array:
    """By how much the spheres should move against (x, y, z) and radius for the points outside them, (n, 4)."""
    own = _nearest(points, centers, radii)
    aside = points - centers[own]
    away = np.linalg.norm(aside, axis=1)
    beyond = (away - radii[own]) * scale + _SLACK
    weight = -strength * np.clip(beyond, 0.0, _STRONGEST)
    slope = [np.bincount(own, weight * side / np.maximum(away, 1e-12), len(radii)) for side in aside.T]
    return np.column_stack([*slope, np.bincount(own, weight, len(radii))])


def _employed(small: Float64Array, centers: Float64Array, radii: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Move each sphere to which no piece would be given to where others would have to grow most."""
    centers, radii = centers.copy(), radii.copy()
    middles = small.mean(axis=1)
    for _ in range(_MOVES):
        own = _nearest(middles, centers, radii)
        idle = np.flatnonzero(np.bincount(own, minlength=len(radii)) == 0)
        if not len(idle):
            break
        beyond = np.linalg.norm(middles - centers[own], axis=1) - radii[own]
        worst = _one_each(own, np.argsort(-beyond, kind="stable"))[: len(idle)]
        # As large as what is beyond the other sphere, but at least as a piece.
        idle = idle[: len(worst)]
        centers[idle], radii[idle] = middles[worst], np.maximum(beyond[worst], _PIECE)
    return centers, radii


def _one_each(own: Int64Array, order: Int64Array) -> Int64Array:
    """The first piece of each sphere in an order of the pieces, in that order."""
    first = np.unique(own[order], return_index=True)[1]
    return order[np.sort(first)]


def _grown(small: Float64Array, inside: Float64Array, centers: Float64Array, radii: Float64Array) -> Float64Array:
    """The radii with which spheres hold the pieces, (m, 3, 3), and points, (k, 3), that are nearest to them."""
    least = np.zeros(len(radii))
    own = _nearest(small.mean(axis=1), centers, radii)
    np.maximum.at(least, own, np.linalg.norm(small - centers[own][:, None], axis=2).max(axis=1))
    own = _nearest(inside, centers, radii)
    # Those that their sphere holds already ask for nothing.
    aside = np.linalg.norm(inside - centers[own], axis=1)
    out = aside > np.maximum(least, radii)[own]
    np.maximum.at(least, own[out], aside[out])
    held = np.zeros(len(radii), bool)
    held[own[~out]] = True
    return np.where(held, np.maximum(least, radii), least) + _ROUNDING


def _inside(scene: Scene, frame: NormalizedFrame) -> Float64Array:
    """Points of a grid inside a watertight mesh, (k, 3) in the frame; none in another."""
    if not topology(scene.faces).watertight:
        return np.zeros((0, 3))
    positions = frame.to_normalized(scene.positions)
    grid = VoxelGrid.from_box(positions.min(axis=0), positions.max(axis=0), _CUBES)
    return grid.points(inside_mesh(positions, scene.faces, grid))


def _nearest(points: Float64Array, centers: Float64Array, radii: Float64Array) -> Int64Array:
    """The sphere in which each point lies deepest, or which is nearest to it, (k,); of many, among near centres.

    Any other choice would do, too, but give larger spheres.
    """
    if len(radii) > _FEW:
        distances, near = cKDTree(centers).query(points, _LISTED)
        best = np.argmin(distances - radii[near], axis=1)
        nearest: Int64Array = near[np.arange(len(points)), best]
        return nearest
    found = np.empty(len(points), np.intp)
    own = np.square(centers).sum(axis=1)
    block = _BLOCK // len(radii)
    for start in range(0, len(points), block):
        some = points[start : start + block]
        squared = np.square(some).sum(axis=1)[:, None] + own - 2 * some @ centers.T
        found[start : start + block] = np.argmin(np.sqrt(np.maximum(squared, 0)) - radii, axis=1)
    return found
