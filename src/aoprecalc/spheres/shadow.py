"""Spheres chosen one by one from many candidates, each the one that adds most to the silhouettes."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from aoprecalc.progress import Progress
from aoprecalc.spheres.fitted import SphereFit
from aoprecalc.spheres.sampling import NormalizedFrame, sample_surface_with_normals
from aoprecalc.spheres.silhouette_descent import SilhouetteDescent
from aoprecalc.spheres.silhouettes import (
    Views,
    disc_spans,
    fibonacci_views,
    mesh_silhouettes,
    span_counts,
    span_sums,
    spheres_per_pixel,
)
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Int32Array, Scene
from aoprecalc.visibility.directions import INV_GOLDEN_RATIO

_HALF = (
    0.8  # of a disc's radius: half the side of the square that stands for it, between the inscribed and the equal one
)


def greedy_selection(
    centers: Float64Array, radii: Float64Array, worth: Float32Array, seen: Views, count: int
) -> NDArray[np.intp]:
    """Return which of c candidates to take, at most `count`, fewer where no more of them gain anything.

    centers (c, 3), radii (c,)
    worth   (d, size, size) float32: what it is worth to cover a pixel of the views `seen`; that counts once
    """
    worth = worth.copy()
    columns, rows = seen.project(centers)
    sizes = radii * seen.scale
    corners = _squares(columns, rows, sizes, seen.size)
    chosen: list[int] = []
    left = np.ones(len(radii), bool)
    while len(chosen) < count and left.any():
        gains = np.where(left, _sums(worth, corners), -np.inf)
        best = int(np.argmax(gains))
        if gains[best] <= 0:
            break
        left[best] = False
        runs = disc_spans(columns[:, best : best + 1], rows[:, best : best + 1], sizes[best : best + 1], seen.size)
        if span_sums(runs, worth, len(seen)).sum() <= 0:
            continue  # its squares gain at their corners, its discs nothing
        chosen.append(best)
        worth[span_counts(runs, len(seen), seen.size) > 0] = 0
    return np.array(chosen, np.intp)


def _squares(columns: Float64Array, rows: Float64Array, radii: Float64Array, size: int) -> list[NDArray[np.int64]]:
    """The four corners of each disc's square in its picture's summed table, as flat indices, (d, c) each."""
    half = np.maximum(_HALF * radii, 0.5)
    left, right = (np.clip(np.rint(columns + side), 0, size).astype(np.int64) for side in (-half, half))
    top, bottom = (np.clip(np.rint(rows + side), 0, size).astype(np.int64) for side in (-half, half))
    table = (np.arange(len(columns)) * (size + 1) ** 2)[:, None]
    return [
        table + row * (size + 1) + column
        for row, column in ((bottom, right), (top, left), (top, right), (bottom, left))
    ]


def _sums(worth: Float32Array, corners: list[NDArray[np.int64]]) -> Float32Array:
    """The sum of `worth` over each candidate's squares, (c,), by summed tables (F. Crow, 1984)."""
    table = np.zeros((len(worth), worth.shape[1] + 1, worth.shape[2] + 1), np.float32)
    np.cumsum(np.cumsum(worth, axis=1), axis=2, out=table[:, 1:, 1:])
    flat = table.ravel()
    a, b, c, d = (np.take(flat, corner) for corner in corners)
    sums: Float32Array = (a + b - c - d).sum(axis=0)
    return sums


# Balls that touch a surface from one side and hold none of it: their centres lie on the medial axis.

_MOST_STEPS = 30
_ENOUGH = 1e-3  # of the radius: a ball that shrinks by less has arrived


def medial_balls(
    points: Float64Array, normals: Float64Array, samples: Float64Array, largest: float
) -> tuple[Float64Array, Float64Array]:
    """Shrink a ball at each point until it holds no sample; returns centres (k, 3) and radii (k,) float64.

    points    (k, 3) on the surface
    normals   (k, 3) unit vectors; the ball at a point lies on the other side
    samples   (s, 3) on the surface
    largest   the radius to start from, which a ball that meets nothing keeps

    (J. Ma, S. W. Bae, S. Choi, "3D medial axis point approximation using nearest neighbors and the normal field",
    2012.)
    """
    tree = cKDTree(samples)
    radii = np.full(len(points), largest)
    moving = np.arange(len(points))
    for _ in range(_MOST_STEPS):
        centers = points[moving] - normals[moving] * radii[moving, None]
        distances, nearest = tree.query(centers)
        away = points[moving] - samples[nearest]
        height = (away * normals[moving]).sum(axis=1)
        squared = np.square(away).sum(axis=1)
        shrinks = (distances < radii[moving] * (1 - _ENOUGH)) & (height > 0)
        # The ball through both points that touches the surface in the first of them.
        moving = moving[shrinks]
        radii[moving] = np.minimum(squared[shrinks] / (2 * height[shrinks]), radii[moving] * (1 - _ENOUGH))
        if not len(moving):
            break
    return points - normals * radii[:, None], radii


# Spheres whose silhouettes are as close to a mesh's as their number allows: what soft shadows are cast by.
#
# Candidates are balls inside the surface, which suit solids, and balls about its points, which suit shells.
# Of them the greedy choice takes as many as are wanted; a descent moves and resizes them; then, again and again, those
# that hardly anyone would miss move to where most is missing.

# Chosen on bunny, bigguy, ogre and fruit fly by what they cost and bring.
_VIEWS, _PIXELS, _TURN = 40, 192, 0.25
_FOR_CHOICE = 20  # of the views: what the greedy choice looks at
VIEWS_PER_STEP = 10  # of the views: what a step of the descent looks at
_CANDIDATES = 1000  # of each kind
_LARGEST = 1.0  # radius of a medial ball, in half the longest side of the box: one that large is outside
_WITHIN = 20_000  # samples that medial balls must not hold
_SIZES = (0.5, 1.0, 1.6)  # of balls about points, in radii of `count` discs that fill a silhouette
_LATER_SIZES = (0.25, 0.5, 1.0)  # the same, in the median of the radii, when spheres move
_ROUNDS, _SHARE = 8, 0.2  # times that spheres move elsewhere, and the share of them that does at first
_SETTLE, _ROUND, _REST = 120, 60, 200  # steps of the descent: after the choice, after each round, in the end


Spheres = tuple[Float64Array, Float64Array]  # centres (n, 3) and radii (n,)


@dataclass(frozen=True, eq=False)
class SilhouetteTarget:
    """A mesh's silhouettes, (d, size, size) bool, in the views `seen`; worth is 1 inside them and -1 outside."""

    seen: Views
    wanted: BoolArray
    worth: Float32Array

    @classmethod
    def of(cls, scene: Scene, frame: NormalizedFrame) -> "SilhouetteTarget":
        """Take the silhouettes of a scene in the frame."""
        positions, faces = frame.to_normalized(scene.positions), scene.faces
        half = 1.1 * float(np.linalg.norm(positions, axis=1).max())
        order = np.argsort(np.arange(_VIEWS) * INV_GOLDEN_RATIO % 1.0)  # so that each run of them looks from all around
        seen = fibonacci_views(_VIEWS, half, _PIXELS, _TURN)[order]
        wanted = mesh_silhouettes(positions, faces, seen)
        return cls(seen, wanted, np.where(wanted, 1, -1).astype(np.float32))

    def likeness(self, centers: Float64Array, radii: Float64Array) -> float:
        """Return intersection over union of silhouettes, in the mean over the views in which there is any."""
        covered = spheres_per_pixel(centers, radii, self.seen) > 0
        union = (covered | self.wanted).sum(axis=(1, 2))
        both = (covered & self.wanted).sum(axis=(1, 2))
        return float((both / np.maximum(union, 1)).sum() / max(1, np.count_nonzero(union)))

    def missed(self, centers: Float64Array, radii: Float64Array) -> Float64Array:
        """Return how many pixels fewer would be right without each sphere, (n,) float64; negative where more would."""
        counts = spheres_per_pixel(centers, radii, self.seen)
        alone = np.where(counts == 1, self.worth, np.float32(0))
        runs = disc_spans(*self.seen.project(centers), radii * self.seen.scale, self.seen.size)
        gained: Float64Array = span_sums(runs, alone, len(self.seen) * len(radii)).reshape(-1, len(radii)).sum(axis=0)
        return gained

    def select(self, candidates: Spheres, beside: Spheres, count: int) -> Int32Array:
        """Return which of the candidates (centres, radii) to add beside other spheres, at most `count`."""
        some = self.seen[:_FOR_CHOICE]
        worth = self.worth[:_FOR_CHOICE]
        if len(beside[1]):
            worth = np.where(spheres_per_pixel(*beside, some) == 0, worth, np.float32(0))
        half = some.size // 2
        # Half the pixels a side are as good, in a third of the time (measured).
        coarse = worth.reshape(len(some), half, 2, half, 2).mean(axis=(2, 4))
        return greedy_selection(*candidates, coarse, replace(some, size=half), count).astype(np.int32)


def fit_shadow(
    scene: Scene,
    frame: NormalizedFrame,
    target: SilhouetteTarget,
    points: Float64Array,
    count: int,
    rng: np.random.Generator,
    progress: Progress,
) -> SphereFit:
    """Fit `count` spheres to the silhouettes of a scene.

    target   of the scene in the frame
    points   (s, 3) float64 samples of its surface in the frame
    Steps of the descent are counted on `progress`. The measure of quality looks from elsewhere.
    """
    disc = np.sqrt(target.wanted.mean() * (2 * target.seen.half) ** 2 / (count * np.pi))
    size = max(float(disc), 1 / target.seen.scale)
    medial = _medial(scene, frame, points[:_WITHIN], rng)

    def descend(spheres: Spheres, steps: int, first: float, last: float) -> Spheres:
        descent = SilhouetteDescent(*spheres, target.wanted, target.seen, VIEWS_PER_STEP)
        for step in range(steps):
            descent.step(first + (last - first) * step / steps)
            progress.advance()
        return descent.centers, descent.radii

    candidates = _and_about(medial, _points(points, _CANDIDATES, rng), [share * size for share in _SIZES])
    chosen = target.select(candidates, (np.zeros((0, 3)), np.zeros(0)), count)
    short = count - len(chosen)  # where no candidate adds anything any more, as far as these views tell
    rest = _points(points, short, rng), np.full(short, 0.3 * size)
    centers, radii = descend(_joined(_taken(candidates, chosen), rest), _SETTLE, 1.0, 0.3)
    best = target.likeness(centers, radii)
    steps = _SETTLE
    for number in range(_ROUNDS if count > 1 else 0):
        going = max(1, int(_SHARE * count * (1 - number / _ROUNDS)))
        order = np.argsort(target.missed(centers, radii), kind="stable")
        go, stay = order[:going], np.sort(order[going:])
        staying = _taken((centers, radii), stay)
        sizes = [share * float(np.median(radii)) for share in _LATER_SIZES]
        candidates = _and_about(medial, _points(points, _CANDIDATES, rng), sizes)
        chosen = target.select(candidates, staying, going)
        spare = go[len(chosen) :]  # they stay for want of a better place
        moved = _joined(staying, _taken(candidates, chosen), _taken((centers, radii), spare))
        tried = descend(moved, _ROUND, 0.7, 0.2)
        steps += _ROUND
        likeness = target.likeness(*tried)
        if likeness > best:
            (centers, radii), best = tried, likeness
    settled = descend((centers, radii), _REST, 0.3, 0.02)
    if target.likeness(*settled) > best:
        centers, radii = settled
    return SphereFit(centers, radii, steps + _REST, converged=True)


def _medial(scene: Scene, frame: NormalizedFrame, within: Float64Array, rng: np.random.Generator) -> Spheres:
    """Balls that touch the surface from either side, as its winding may not tell which is inside."""
    points, normals = sample_surface_with_normals(scene, frame, _CANDIDATES, rng)
    balls = _joined(*(medial_balls(points, side * normals, within, _LARGEST) for side in (1, -1)))
    return _taken(balls, np.flatnonzero(balls[1] < 0.99 * _LARGEST))


def _and_about(balls: Spheres, points: Float64Array, sizes: list[float]) -> Spheres:
    """Add balls of each size about points, (k, 3)."""
    return _joined(balls, *((points, np.full(len(points), size)) for size in sizes))


def _joined(*sets: Spheres) -> Spheres:
    centers, radii = (np.concatenate(part) for part in zip(*sets, strict=True))
    return centers, radii


def _taken(spheres: Spheres, which: NDArray[np.integer]) -> Spheres:
    return spheres[0][which], spheres[1][which]


def _points(points: Float64Array, count: int, rng: np.random.Generator) -> Float64Array:
    """Pick samples at random, with repeats where there are too few."""
    picked: Float64Array = points[rng.integers(len(points), size=count)]
    return picked
