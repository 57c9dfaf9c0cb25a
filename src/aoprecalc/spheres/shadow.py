"""Method shadow: spheres whose silhouettes match a mesh's as closely as their number allows, as soft shadows need it.

Candidates are medial balls, which suit solids, and balls centred on the surface, which suit thin shells. A greedy
selection takes as many as are wanted, and gradient descent moves and resizes them. Then, in several rounds, the spheres
that contribute least move to where most of the silhouettes is missing.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.progress import Progress
from aoprecalc.spheres.sampling import NormalizedFrame, SphereFit, sample_points_with_normals
from aoprecalc.spheres.silhouettes import (
    SilhouetteDescent,
    Views,
    disc_spans,
    fibonacci_views,
    mesh_silhouettes,
    span_counts,
    span_sums,
    spheres_per_pixel,
)
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array, Scene
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO

# Chosen by cost and quality on bunny, bigguy, ogre and fruit fly.
_VIEWS, _RESOLUTION, _VIEW_TURN = 40, 192, 0.25
_SELECTION_VIEWS = 20  # for the greedy selection
VIEWS_PER_STEP = 10  # for a step of the descent
_CANDIDATES = 1000  # of each kind
_MAX_MEDIAL_RADIUS = 1.0  # normalised; balls that reach this radius are outside and dropped
_MEDIAL_SAMPLES = 20_000  # surface samples that medial balls must not contain
_SURFACE_BALL_SIZES = (0.5, 1.0, 1.6)  # in units of r, where `count` discs of radius r have the mean silhouette area
_LATER_SIZES = (0.25, 0.5, 1.0)  # in median radii, for spheres that move
_ROUNDS, _FIRST_MOVED = 8, 0.2  # number of rounds, and the fraction of the spheres that moves in the first
_SELECTION_STEPS, _ROUND_STEPS, _FINAL_STEPS = 120, 60, 200  # of the descent
_SQUARE_SIZE = 0.8  # half side / disc radius of the square that stands for a disc: between inscribed and equal area

_MAX_SHRINK_STEPS = 30  # of a medial ball
_SHRINK_TOLERANCE = 1e-3  # relative; a ball that would shrink by less has converged

Spheres = tuple[Float64Array, Float64Array]  # centres (n, 3) and radii (n,)


@dataclass(frozen=True, eq=False)
class SilhouetteTarget:
    """The silhouettes of a mesh.

    views     directions in an order in which each run of views covers all sides
    masks     (d, resolution, resolution) bool
    weights   (d, resolution, resolution) float32: 1 inside the silhouettes, -1 outside
    """

    views: Views
    masks: BoolArray
    weights: Float32Array

    @classmethod
    def from_scene(cls, scene: Scene, frame: NormalizedFrame) -> "SilhouetteTarget":
        """Rasterise the silhouettes of a scene in normalised coordinates."""
        positions, faces = frame.to_normalized(scene.positions), scene.faces
        half_extent = 1.1 * float(np.linalg.norm(positions, axis=1).max())
        order = np.argsort(np.arange(_VIEWS) * INV_GOLDEN_RATIO % 1.0)
        views = fibonacci_views(_VIEWS, half_extent, _RESOLUTION, _VIEW_TURN)[order]
        masks = mesh_silhouettes(positions, faces, views)
        return cls(views, masks, np.where(masks, 1, -1).astype(np.float32))

    def iou(self, centers: Float64Array, radii: Float64Array) -> float:
        """Return intersection over union of the silhouettes, averaged over the views whose union is not empty."""
        covered = spheres_per_pixel(centers, radii, self.views) > 0
        union = (covered | self.masks).sum(axis=(1, 2))
        both = (covered & self.masks).sum(axis=(1, 2))
        return float((both / np.maximum(union, 1)).sum() / max(1, np.count_nonzero(union)))

    def spill(self, centers: Float64Array, radii: Float64Array) -> float:
        """Return the spheres' silhouettes outside the mesh's, over the area of the mesh's, averaged over the views."""
        outside = (spheres_per_pixel(centers, radii, self.views) > 0) & ~self.masks
        return float((outside.sum(axis=(1, 2)) / np.maximum(self.masks.sum(axis=(1, 2)), 1)).mean())

    def contributions(self, centers: Float64Array, radii: Float64Array) -> Float64Array:
        """Return the net number of correct pixels that would be lost without each sphere, (n,) float64."""
        counts = spheres_per_pixel(centers, radii, self.views)
        return self.sums_inside(centers, radii, np.where(counts == 1, self.weights, np.float32(0)))

    def own_spill(self, centers: Float64Array, radii: Float64Array) -> Float64Array:
        """Return the area that each sphere alone covers outside the mesh's silhouettes, (n,): the mean over the views.

        In normalised units.
        """
        alone = (spheres_per_pixel(centers, radii, self.views) == 1) & ~self.masks
        pixels = self.sums_inside(centers, radii, alone.astype(np.float32))
        return pixels / (len(self.views) * self.views.pixels_per_unit**2)

    def sums_inside(self, centers: Float64Array, radii: Float64Array, images: Float32Array) -> Float64Array:
        """Return the sum of the pixels of images, (d, resolution, resolution), in each sphere's discs, (n,) float64."""
        spans = disc_spans(*self.views.project(centers), radii * self.views.pixels_per_unit, self.views.resolution)
        sums: Float64Array = span_sums(spans, images, len(self.views) * len(radii)).reshape(-1, len(radii)).sum(axis=0)
        return sums

    def equal_area_radius(self, count: int) -> float:
        """Return the normalised radius of discs, `count` of which have the mean area of the silhouettes."""
        area = self.masks.mean() * (2 * self.views.half_extent) ** 2
        return max(float(np.sqrt(area / (count * np.pi))), 1 / self.views.pixels_per_unit)

    def select(self, candidates: Spheres, fixed: Spheres, count: int) -> Int32Array:
        """Return the indices of the candidates to add to the fixed spheres, at most `count`."""
        views = self.views[:_SELECTION_VIEWS]
        weights = self.weights[:_SELECTION_VIEWS]
        if len(fixed[1]):
            weights = np.where(spheres_per_pixel(*fixed, views) == 0, weights, np.float32(0))
        half = views.resolution // 2
        # Half the resolution selects as well, in a third of the time.
        coarse = weights.reshape(len(views), half, 2, half, 2).mean(axis=(2, 4))
        return greedy_selection(*candidates, coarse, replace(views, resolution=half), count).astype(np.int32)


def fit_shadow(
    scene: Scene,
    frame: NormalizedFrame,
    target: SilhouetteTarget,
    points: Float64Array,
    count: int,
    rng: np.random.Generator,
    progress: Progress,
    rounds: int = _ROUNDS,
    final_steps: int = _FINAL_STEPS,
) -> SphereFit:
    """Fit `count` spheres to the silhouettes of a scene.

    target        the scene's silhouettes; `silhouette_quality` uses other views
    points        (s, 3) float64: samples of the surface in normalised coordinates
    rounds        how often spheres move to other places
    final_steps   of the descent, after the last round
    Each step of the descent advances `progress` by one.
    """
    size = target.equal_area_radius(count)
    medial = _medial_candidates(scene, frame, points[:_MEDIAL_SAMPLES], rng)

    def descend(spheres: Spheres, steps: int, first: float, last: float) -> Spheres:
        """Run descent steps whose size falls linearly from `first` to `last` pixels."""
        descent = SilhouetteDescent(*spheres, target.masks, target.views, VIEWS_PER_STEP)
        for step in range(steps):
            descent.step(first + (last - first) * step / steps)
            progress.advance()
        return descent.centers, descent.radii

    candidates = _with_surface_balls(medial, _pick(points, _CANDIDATES, rng), [s * size for s in _SURFACE_BALL_SIZES])
    selected = target.select(candidates, (np.zeros((0, 3)), np.zeros(0)), count)
    missing = count - len(selected)  # no further candidate improves the selection's views
    rest = _pick(points, missing, rng), np.full(missing, 0.3 * size)
    centers, radii = descend(_concatenate(_take(candidates, selected), rest), _SELECTION_STEPS, 1.0, 0.3)
    best_iou = target.iou(centers, radii)
    steps = _SELECTION_STEPS
    for index in range(rounds if count > 1 else 0):
        move_count = max(1, int(_FIRST_MOVED * count * (1 - index / rounds)))
        order = np.argsort(target.contributions(centers, radii), kind="stable")
        movable, fixed_index = order[:move_count], np.sort(order[move_count:])
        fixed = _take((centers, radii), fixed_index)
        sizes = [s * float(np.median(radii)) for s in _LATER_SIZES]
        candidates = _with_surface_balls(medial, _pick(points, _CANDIDATES, rng), sizes)
        selected = target.select(candidates, fixed, move_count)
        unmoved = _take((centers, radii), movable[len(selected) :])  # there is no better place for them
        moved = _concatenate(fixed, _take(candidates, selected), unmoved)
        candidate = descend(moved, _ROUND_STEPS, 0.7, 0.2)
        steps += _ROUND_STEPS
        iou = target.iou(*candidate)
        if iou > best_iou:
            (centers, radii), best_iou = candidate, iou
    final = descend((centers, radii), final_steps, 0.3, 0.02)
    if target.iou(*final) > best_iou:
        centers, radii = final
    return SphereFit(centers, radii, steps + final_steps, converged=True)


def greedy_selection(
    centers: Float64Array, radii: Float64Array, weights: Float32Array, views: Views, count: int
) -> Int64Array:
    """Select spheres one by one, each the one that increases the weight of the covered pixels most.

    centers   (c, 3): the candidates'
    radii     (c,)
    weights   (d, resolution, resolution) float32: of a pixel in each view; covering it again adds nothing
    Returns the indices of at most `count` candidates, fewer if no further one increases the sum.
    """
    weights = weights.copy()
    columns, rows = views.project(centers)
    sizes = radii * views.pixels_per_unit
    corners = _square_corners(columns, rows, sizes, views.resolution)
    selected: list[int] = []
    available = np.ones(len(radii), bool)
    while len(selected) < count and available.any():
        gains = np.where(available, _square_sums(weights, corners), -np.inf)
        best = int(np.argmax(gains))
        if gains[best] <= 0:
            break
        available[best] = False
        column, row, size = columns[:, best : best + 1], rows[:, best : best + 1], sizes[best : best + 1]
        spans = disc_spans(column, row, size, views.resolution)
        if span_sums(spans, weights, len(views)).sum() <= 0:
            continue  # the square approximation predicts a gain that the rasterized disc does not have
        selected.append(best)
        weights[span_counts(spans, len(views), views.resolution) > 0] = 0
    return np.array(selected, np.intp)


def _square_corners(columns: Float64Array, rows: Float64Array, radii: Float64Array, size: int) -> list[Int64Array]:
    """Return the four corners of each disc's square as flat indices into the summed-area tables, (d, c) each."""
    half = np.maximum(_SQUARE_SIZE * radii, 0.5)
    left, right = (np.clip(np.rint(columns + offset), 0, size).astype(np.int64) for offset in (-half, half))
    top, bottom = (np.clip(np.rint(rows + offset), 0, size).astype(np.int64) for offset in (-half, half))
    table = (np.arange(len(columns)) * (size + 1) ** 2)[:, None]
    return [
        table + row * (size + 1) + column
        for row, column in ((bottom, right), (top, left), (top, right), (bottom, left))
    ]


def _square_sums(weights: Float32Array, corners: list[Int64Array]) -> Float32Array:
    """Return the sum of the weights over each candidate's squares, (c,), by summed-area tables (F. Crow, 1984)."""
    table = np.zeros((len(weights), weights.shape[1] + 1, weights.shape[2] + 1), np.float32)
    np.cumsum(np.cumsum(weights, axis=1), axis=2, out=table[:, 1:, 1:])
    flat = table.ravel()
    a, b, c, d = (np.take(flat, corner) for corner in corners)
    sums: Float32Array = (a + b - c - d).sum(axis=0)
    return sums


def medial_balls(
    points: Float64Array, normals: Float64Array, samples: Float64Array, max_radius: float
) -> tuple[Float64Array, Float64Array]:
    """Return balls that touch the surface at points and contain no samples; their centres lie on the medial axis.

    points       (k, 3) on the surface
    normals      (k, 3) unit vectors; the ball at a point lies on the opposite side
    samples      (s, 3) on the surface
    max_radius   initial radius, which a ball that contains no sample keeps

    Returns centres (k, 3) and radii (k,) float64. Shrinking-ball algorithm: J. Ma, S. W. Bae, S. Choi, 3D medial axis
    point approximation using nearest neighbors and the normal field, 2012.
    """
    tree = cKDTree(samples)
    radii = np.full(len(points), max_radius)
    active = np.arange(len(points))
    for _ in range(_MAX_SHRINK_STEPS):
        centers = points[active] - normals[active] * radii[active, None]
        distances, nearest = tree.query(centers)
        offsets = points[active] - samples[nearest]
        height = (offsets * normals[active]).sum(axis=1)
        squared = np.square(offsets).sum(axis=1)
        shrinks = (distances < radii[active] * (1 - _SHRINK_TOLERANCE)) & (height > 0)
        # The ball through both points that touches the surface at the first.
        active = active[shrinks]
        radii[active] = np.minimum(squared[shrinks] / (2 * height[shrinks]), radii[active] * (1 - _SHRINK_TOLERANCE))
        if not len(active):
            break
    return points - normals * radii[:, None], radii


def _medial_candidates(
    scene: Scene, frame: NormalizedFrame, samples: Float64Array, rng: np.random.Generator
) -> Spheres:
    """Return medial balls on both sides of the surface, as the winding may not tell which side is inside."""
    points, normals = sample_points_with_normals(scene, frame, _CANDIDATES, rng)
    balls = _concatenate(*(medial_balls(points, side * normals, samples, _MAX_MEDIAL_RADIUS) for side in (1, -1)))
    return _take(balls, np.flatnonzero(balls[1] < 0.99 * _MAX_MEDIAL_RADIUS))


def _with_surface_balls(balls: Spheres, points: Float64Array, sizes: list[float]) -> Spheres:
    """Add balls of each radius in `sizes` centred at points, (k, 3)."""
    return _concatenate(balls, *((points, np.full(len(points), size)) for size in sizes))


def _concatenate(*sets: Spheres) -> Spheres:
    centers, radii = (np.concatenate(part) for part in zip(*sets, strict=True))
    return centers, radii


def _take(spheres: Spheres, index: NDArray[np.integer]) -> Spheres:
    return spheres[0][index], spheres[1][index]


def _pick(points: Float64Array, count: int, rng: np.random.Generator) -> Float64Array:
    """Choose points at random, with replacement."""
    picked: Float64Array = points[rng.integers(len(points), size=count)]
    return picked
