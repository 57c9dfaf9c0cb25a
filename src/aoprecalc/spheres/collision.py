"""Method collision: spheres that contain the whole surface, and the inside of a closed mesh, and protrude little.

Spheres of method shadow, after few of its rounds, are the start. The same descent continues, with an additional pull on
the nearest sphere from each point outside all spheres. After each of several rounds of it, spheres take the least radii
that contain the points given to them; then those that spill most are split in two, in exchange for as many whose points
others take over. A round that spills more than the best one is undone. At last the spheres grow a little until they
contain every piece of the surface, rather than points of it.
"""

from dataclasses import dataclass

import numpy as np

from aoprecalc.mesh.topology import topology
from aoprecalc.progress import Progress
from aoprecalc.spheres.containment import (
    containing_radii,
    enclosing_balls,
    largest_per_owner,
    nearest_spheres,
    pieces_outside,
    subdivide,
    thinned,
)
from aoprecalc.spheres.sampling import NormalizedFrame, SphereFit, VoxelGrid, inside_mesh
from aoprecalc.spheres.shadow import VIEWS_PER_STEP, SilhouetteTarget, Spheres, fit_shadow
from aoprecalc.spheres.silhouettes import SilhouetteDescent
from aoprecalc.types import BoolArray, Float64Array, Int64Array, Scene

# Chosen by spill and cost on bunny, bigguy, ogre, spot and fruit fly. Lengths are normalised.
_SHADOW_ROUNDS = 4
_FIRST_STEPS, _ROUNDS, _ROUND_STEPS, _LAST_PARTS, _PART_STEPS = 60, 6, 60, 3, 50  # of the descent
_FIRST_SPLIT = 0.2  # fraction of the spheres that are split in the first round, at most
_FIRST_PULL, _PULL, _LAST_PULL = 0.4, 8.0, 12.0  # of all points together, relative to the silhouettes' area
_POINTS_PER_STEP = 4000
_PULL_MARGIN, _MAX_PULL = 0.3, 4.0  # pixels: depth inside a sphere from which a point pulls, and the cap of its pull
_MAX_EDGE = 0.03  # of the triangles whose corners are the points that pull
_POINT_SPACING = 0.2  # of those points, in radii of discs that have the silhouettes' area
_MIN_SPACING = 0.004
_CHECKED_EDGE, _FINAL_EDGE = 0.003, 0.0005  # of pieces that are found outside, and for which spheres grow at last
_LAST_CHECKS = 1
_VOXEL_RESOLUTION = 48  # along the longest side of the grid whose points inside the mesh must be contained
_TOLERATED_COST = 3.0  # of giving up a sphere, relative to the gain of splitting one: the descent makes up for it
_MIN_RADIUS = 0.25  # pixels: of a sphere that need not contain anything


@dataclass(frozen=True, eq=False)
class _Surface:
    """What spheres must contain.

    triangles   (m, 3, 3) float64: the surface, in pieces with short edges
    inside      (k, 3) float64: grid points inside a watertight mesh; none if it is not watertight
    spacing     least distance at which points are told apart, > 0
    """

    triangles: Float64Array
    inside: Float64Array
    spacing: float

    def points(self) -> Float64Array:
        """Return corners of the pieces and points inside, one in each cube of the spacing's size, (p, 3)."""
        return thinned(np.concatenate([self.triangles.reshape(-1, 3), self.inside]), self.spacing)

    def with_points_outside(self, points: Float64Array, spheres: Spheres) -> Float64Array:
        """Return points, (p, 3), and those that spheres should contain besides but do not."""
        pieces, _ = pieces_outside(self.triangles, *spheres, _CHECKED_EDGE)
        candidates = np.concatenate([pieces.reshape(-1, 3), self.inside])
        outside = candidates[nearest_spheres(candidates, *spheres)[1][:, 0] > 0]
        return np.concatenate([points, thinned(outside, self.spacing / 4)])


def fit_collision(
    scene: Scene,
    frame: NormalizedFrame,
    points: Float64Array,
    count: int,
    rng: np.random.Generator,
    progress: Progress,
) -> SphereFit:
    """Fit `count` spheres that contain the surface of a scene, up to the rounding of coordinates.

    points   (s, 3) float64: samples of the surface in normalised coordinates
    The inside of a watertight mesh is contained at the points of a grid, 48 along the longest side of its box.
    """
    target = SilhouetteTarget.from_scene(scene, frame)
    initial = fit_shadow(scene, frame, target, points, count, rng, progress, _SHADOW_ROUNDS, final_steps=0)
    triangles = subdivide(frame.to_normalized(scene.corners), _MAX_EDGE)
    spacing = max(_POINT_SPACING * target.equal_area_radius(count), _MIN_SPACING)
    surface = _Surface(triangles, _points_inside(scene, frame), spacing)
    required = surface.points()

    descent = _PulledDescent((initial.centers, initial.radii), target, rng, progress)
    descent.run(required, _FIRST_STEPS, (0.5, 0.2), (_FIRST_PULL, _PULL))
    steps = initial.iterations + _FIRST_STEPS
    best, best_spill = _contained(descent.spheres, target, required), np.inf
    for index in range(_ROUNDS + 1 if count > 1 else 0):
        contained = _contained(descent.spheres, target, required)
        spill = target.spill(*contained)
        if spill < best_spill:
            best, start, best_spill = contained, descent.spheres, spill
        if index == _ROUNDS:
            descent = _PulledDescent(start, target, rng, progress)
            break
        split_count = max(1, int(_FIRST_SPLIT * count * (1 - index / _ROUNDS)))
        descent = _PulledDescent(_exchanged(best, target, required, split_count), target, rng, progress)
        descent.run(required, _ROUND_STEPS, (0.5, 0.15), (_PULL, _LAST_PULL))
        steps += _ROUND_STEPS
    for part in range(_LAST_PARTS):
        required = surface.with_points_outside(required, best)
        first, last = (0.3 + (0.03 - 0.3) * (part + end) / _LAST_PARTS for end in (0, 1))
        descent.run(required, _PART_STEPS, (first, last), (_LAST_PULL, _LAST_PULL))
        best = _contained(descent.spheres, target, required)
        steps += _PART_STEPS
    for _ in range(_LAST_CHECKS):
        required = surface.with_points_outside(required, best)
        best = _contained(descent.spheres, target, required)
    centers, radii = best
    radii = np.maximum(radii, _MIN_RADIUS / target.views.pixels_per_unit)
    radii = containing_radii(triangles, surface.inside, centers, radii, _FINAL_EDGE)
    return SphereFit(centers, radii, steps, converged=True)


class _PulledDescent:
    """The descent on silhouettes, with the pull of points outside the spheres."""

    def __init__(
        self, spheres: Spheres, target: SilhouetteTarget, rng: np.random.Generator, progress: Progress
    ) -> None:
        self._descent = SilhouetteDescent(*spheres, target.masks, target.views, VIEWS_PER_STEP)
        self._area = target.masks.sum() / len(target.views)
        self._pixels_per_unit = target.views.pixels_per_unit
        self._rng, self._progress = rng, progress

    @property
    def spheres(self) -> Spheres:
        """The spheres after the last step."""
        return self._descent.centers, self._descent.radii

    def run(self, points: Float64Array, steps: int, sizes: tuple[float, float], pulls: tuple[float, float]) -> None:
        """Take steps; their size, in pixels, and the pull of the points, (p, 3), each go from one value to another."""
        for step in range(steps):
            size, pull = (first + (last - first) * step / steps for first, last in (sizes, pulls))
            pulling = points[self._rng.integers(len(points), size=_POINTS_PER_STEP)]
            strength = pull * self._area / _POINTS_PER_STEP
            self._descent.step(size, _pull_gradient(pulling, self.spheres, self._pixels_per_unit, strength))
            self._progress.advance()


def _points_inside(scene: Scene, frame: NormalizedFrame) -> Float64Array:
    """Return grid points inside a watertight mesh in normalised coordinates, (k, 3); none if it is not watertight."""
    if not topology(scene.faces).watertight:
        return np.zeros((0, 3))
    positions = frame.to_normalized(scene.positions)
    grid = VoxelGrid.from_box(positions.min(axis=0), positions.max(axis=0), _VOXEL_RESOLUTION)
    return grid.centers(inside_mesh(positions, scene.faces, grid))


def _pull_gradient(points: Float64Array, spheres: Spheres, pixels_per_unit: float, strength: float) -> Float64Array:
    """Return the gradient with respect to (x, y, z, r) that pulls spheres to points outside them, (n, 4)."""
    centers, radii = spheres
    nearest, signed = (column[:, 0] for column in nearest_spheres(points, centers, radii))
    directions = (points - centers[nearest]) / np.maximum(signed + radii[nearest], 1e-12)[:, None]
    weight = -strength * np.clip(signed * pixels_per_unit + _PULL_MARGIN, 0.0, _MAX_PULL)
    gradient = [np.bincount(nearest, weight * axis, len(radii)) for axis in directions.T]
    return np.column_stack([*gradient, np.bincount(nearest, weight, len(radii))])


def _contained(spheres: Spheres, target: SilhouetteTarget, points: Float64Array) -> Spheres:
    """Give each point, (p, 3), to its nearest sphere, and return spheres that contain their points.

    A sphere keeps its centre, or becomes the smallest ball around its points if that spills less.
    """
    centers, radii = spheres
    owner = nearest_spheres(points, centers, radii)[0][:, 0]
    radii = largest_per_owner(np.linalg.norm(points - centers[owner], axis=1), owner, len(radii))
    smallest = enclosing_balls(points, owner, centers)
    outside = np.where(target.masks, np.float32(0), np.float32(1))
    better = target.sums_inside(*smallest, outside) < target.sums_inside(centers, radii, outside)
    return np.where(better[:, None], smallest[0], centers), np.where(better, smallest[1], radii)


def _exchanged(spheres: Spheres, target: SilhouetteTarget, points: Float64Array, count: int) -> Spheres:
    """Split up to `count` spheres in two, and give up as many others.

    points   (p, 3): spheres contain those that are nearest to them

    Area is what counts. A split gains the share of a sphere's own spill by which its halves' discs are smaller. Giving
    up a sphere costs the growth of its neighbours' discs, less its own spill.
    """
    centers, radii = spheres[0].copy(), spheres[1].copy()
    nearest, signed = nearest_spheres(points, centers, radii, 2)
    owner = nearest[:, 0]
    own_spill = target.own_spill(centers, radii)
    pairs, pair = np.unique(owner * len(radii) + nearest[:, 1], return_inverse=True)
    giver, taker = np.divmod(pairs, len(radii))
    growth = largest_per_owner(np.maximum(signed[:, 1], 0), pair, len(pairs))
    cost = np.bincount(giver, np.pi * growth * (2 * radii[taker] + growth), len(radii)) - own_spill

    sizes = np.bincount(owner, minlength=len(radii))
    split = [sphere for sphere in np.argsort(-own_spill, kind="stable")[: 3 * count] if sizes[sphere] > 1]
    members = [np.flatnonzero(owner == sphere) for sphere in split]
    halves = [2 * rank + _far_half(points[index]) for rank, index in enumerate(members)]
    if not split:
        return spheres
    half_centers, half_radii = enclosing_balls(
        points[np.concatenate(members)], np.concatenate(halves), np.repeat(centers[split], 2, axis=0)
    )
    share = np.square(half_radii).reshape(-1, 2).sum(axis=1) / np.maximum(np.square(radii[split]), 1e-300)
    gain = own_spill[split] * (1 - share)
    given_up = iter(np.argsort(cost, kind="stable"))
    used: set[int] = set()
    for rank in np.argsort(-gain, kind="stable")[:count]:
        sphere = split[rank]
        if gain[rank] <= 0:
            break
        if sphere in used:
            continue
        other = next((other for other in given_up if other not in used and other != sphere), None)
        if other is None or cost[other] >= _TOLERATED_COST * gain[rank]:
            break
        used |= {sphere, other}
        centers[[sphere, other]] = half_centers[2 * rank : 2 * rank + 2]
        radii[[sphere, other]] = half_radii[2 * rank : 2 * rank + 2]
    return centers, radii


def _far_half(points: Float64Array) -> Int64Array:
    """Return 1 for the points, (p, 3), in the farther half along their principal axis, 0 for others, (p,) int64."""
    offsets = points - points.mean(axis=0)
    along = offsets @ np.linalg.eigh(offsets.T @ offsets)[1][:, 2]
    far: BoolArray = along > (along.min() + along.max()) / 2
    return far.astype(np.int64)
