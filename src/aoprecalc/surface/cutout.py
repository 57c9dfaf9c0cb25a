"""The triangles of a scene that stop light: those without holes as they are, of the others the pieces between the holes.

Triangles are quartered until a quarter is certainly opaque, certainly clear, or as small as is useful; then the border
of the hole is cut through it. Whoever renders or traces rays thus sees triangles alone.

After H. Gruen, C. Benthin, S. Woop: Sub-triangle opacity masks for faster ray tracing of transparent objects, Proc. ACM
Comput. Graph. Interact. Tech. 3(2), 2020, and NVIDIA's opacity micro-maps, which both quarter triangles alike but keep
bits, not pieces; the cut is that of marching triangles.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Cutout, Doubles, Floats, Ints, Mask, Part, Scene, Wrap

_BUDGET = 2_000_000  # pieces
_FINEST = 1 / 2048  # of the diagonal of all that takes part: edges are not halved below it
_TEXELS = 0.5  # the longest side of the smallest pieces: a chequer of single texels is grey wherever texels meet
_TOLERANCE = 1 / 100  # of a piece's area, for which it is not worth quartering
_SPECK = 1e-14  # of a triangle's area, below which a piece is none
_PYRAMID = 2048  # cells along a side of the finest bounds at most
_BLOCK = 1 << 15  # pieces looked at together, that their numbers stay in the cache

# A node is a row of five int32: the number of its triangle, how often that was halved, i, j and side (1 or -1). In
# units of the halved sides 0-1 and 0-2 of the triangle its corners lie at (i, j), (i + side, j), (i, j + side).
_TRIANGLE, _DEPTH, _SIDE = 0, 1, 4
_CORNERS = np.array([(0, 0), (1, 0), (0, 1)], np.int32)
# The corners of a node's quarters as weights, (4, 3, 3), of its own.
_QUARTERS = (
    np.array(
        [
            [(2, 0, 0), (1, 1, 0), (1, 0, 1)],
            [(1, 1, 0), (0, 2, 0), (0, 1, 1)],
            [(1, 0, 1), (0, 1, 1), (0, 0, 2)],
            [(0, 1, 1), (1, 0, 1), (1, 1, 0)],
        ]
    )
    / 2
)
_UNKNOWN, _CLEAR, _OPAQUE = 0, -1, 1


def opaque_triangles(scene: Scene, budget: int = _BUDGET) -> Doubles:
    """Return the corners, (o, 3, 3), of the triangles that are in the light's way, wound as their faces are.

    budget   how many pieces the faces with holes may become; less than two a face count as two
    """
    solid = scene.corners[scene.occludes & scene.of_parts(part.look.cutout is None for part in scene.parts)]
    cards = _Cards.of(scene)
    if not len(cards.corners):
        return solid
    there = scene.corners[scene.occludes | scene.receives].reshape(-1, 3)
    finest = _FINEST * float(np.linalg.norm(np.ptp(there, axis=0)))
    return np.concatenate([solid, *_pieces(cards, _levels(cards, finest, budget))])


@dataclass(frozen=True, eq=False)
class _Picture:
    """An alpha with what bounds it. Places are (u, 1 - v), as rows run.

    alpha    (h, w) float32
    wraps    what it does beyond [0, 1] along u and v
    bounds   (c, 2) float32: least and greatest alpha in cells of UV space, the finest grid first, row after row
    grids    (l, 3): where the grid of a level begins in bounds, its columns and rows, powers of two
    """

    alpha: Floats
    wraps: tuple[Wrap, Wrap]
    bounds: Floats
    grids: NDArray[np.int64]

    @classmethod
    def of(cls, alpha: Floats, wraps: tuple[Wrap, Wrap]) -> Self:
        extremes = []
        for extreme in (np.minimum, np.maximum):
            cells = alpha
            for axis, wrap in enumerate(reversed(wraps)):
                cells = _footprints(cells, axis, wrap, extreme)
            extremes.append([cells])
            while cells.size > 1:
                for axis in (0, 1):
                    if cells.shape[axis] > 1:
                        cells = extreme(
                            cells.take(range(0, cells.shape[axis], 2), axis),
                            cells.take(range(1, cells.shape[axis], 2), axis),
                        )
                extremes[-1].append(cells)
        shapes = np.array([cells.shape for cells in extremes[0]])
        starts = np.cumsum([0, *shapes.prod(axis=1)])[:-1]
        bounds = np.stack([np.concatenate([cells.ravel() for cells in levels]) for levels in extremes], axis=1)
        return cls(alpha, wraps, bounds, np.column_stack([starts, shapes[:, 1], shapes[:, 0]]))

    def at(self, places: Doubles) -> Doubles:
        """Return the bilinear alpha, (m,), at (m, 2) places."""
        height, width = self.alpha.shape
        texels = places * (width, height) - 0.5
        first = np.floor(texels).astype(np.int64)
        share = texels - first
        left, right = (_wrapped(first[:, 0] + k, width, self.wraps[0]) for k in (0, 1))
        upper, lower = (_wrapped(first[:, 1] + k, height, self.wraps[1]) * width for k in (0, 1))
        alpha = self.alpha.ravel()

        def row(start: NDArray[np.int64]) -> Doubles:
            from_, to = alpha[start + left], alpha[start + right]
            mixed: Doubles = from_ + share[:, 0] * (to - from_)
            return mixed

        above, below = row(upper), row(lower)
        return above + share[:, 1] * (below - above)

    def between(self, low: Doubles, high: Doubles) -> Floats:
        """Return bounds, (m, 2), of the alpha in the rectangles between (m, 2) places."""
        cells = self.grids[0, 1:]
        first, last = (np.floor(end * cells).astype(np.int64) for end in (low, high))
        # The level at which two cells in a row and two in a column hold it all.
        level = np.minimum(np.frexp((last - first).max(axis=1))[1], len(self.grids) - 1)
        start, *sizes = self.grids[level].T
        columns, rows = (
            [_wrapped(end[:, axis] >> level, sizes[axis], self.wraps[axis]) for end in (first, last)] for axis in (0, 1)
        )
        found = [self.bounds[start + row * sizes[0] + column] for row in rows for column in columns]
        least, most = (extreme.reduce([f[:, k] for f in found]) for k, extreme in enumerate((np.minimum, np.maximum)))
        return np.stack([least, most], axis=1)


def _wrapped(index: NDArray[np.int64], size: int | NDArray[np.int64], wrap: Wrap) -> NDArray[np.int64]:
    """Return where a texel, or a cell of the bounds, is in a picture of `size` of them."""
    if wrap == "clamp":
        return np.clip(index, 0, size - 1)
    if wrap == "repeat":
        return index % size
    turned = index % (2 * size)
    return np.minimum(turned, 2 * size - 1 - turned)


def _footprints(alpha: Floats, axis: int, wrap: Wrap, extreme: np.ufunc) -> Floats:
    """Return the extremes of the texels that have a say in each of a power of two of cells along an axis."""
    size = alpha.shape[axis]
    count = min(1 << (size - 1).bit_length(), _PYRAMID)
    ends = np.arange(count + 1) * (size / count)
    first, last = np.floor(ends[:-1] - 0.5).astype(np.int64), np.ceil(ends[1:] - 0.5).astype(np.int64)
    texels = _wrapped(np.arange(-1, size + 2), size, wrap)
    runs = np.column_stack([first + 1, last + 2]).ravel()
    cells: Floats = extreme.reduceat(alpha.take(texels, axis), runs, axis).take(range(0, 2 * count, 2), axis)
    return cells


@dataclass(frozen=True, eq=False)
class _Cards:
    """All faces with holes that are in the light's way.

    corners    (n, 3, 3) float64
    marks      (n, 3, 3) float64: u, 1 - v and the factor at each corner
    cutoffs    (n,) float64
    pictures   each once
    shows      (n,): the number of the picture on each
    """

    corners: Doubles
    marks: Doubles
    cutoffs: Doubles
    pictures: tuple[_Picture, ...]
    shows: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene) -> Self: ...
