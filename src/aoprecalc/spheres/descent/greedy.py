"""Spheres chosen one by one from many candidates, each the one that adds most to the silhouettes."""

import numpy as np
from numpy.typing import NDArray

from aoprecalc.model import Doubles, Floats
from aoprecalc.spheres.likeness.silhouettes import Views, counted, disc_runs, run_sums

_HALF = (
    0.8  # of a disc's radius: half the side of the square that stands for it, between the inscribed and the equal one
)


def choose(centers: Doubles, radii: Doubles, worth: Floats, seen: Views, count: int) -> NDArray[np.intp]:
    """Return which of c candidates to take, at most `count`, fewer where no more of them gain anything.

    centers (c, 3), radii (c,)
    worth   (d, size, size) float32: what it is worth to cover a pixel of the views `seen`; that counts once
    """
    worth = worth.copy()
    columns, rows = seen.places(centers)
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
        runs = disc_runs(columns[:, best : best + 1], rows[:, best : best + 1], sizes[best : best + 1], seen.size)
        if run_sums(runs, worth, len(seen)).sum() <= 0:
            continue  # its squares gain at their corners, its discs nothing
        chosen.append(best)
        worth[counted(runs, len(seen), seen.size) > 0] = 0
    return np.array(chosen, np.intp)


def _squares(columns: Doubles, rows: Doubles, radii: Doubles, size: int) -> list[NDArray[np.int64]]:
    """The four corners of each disc's square in its picture's summed table, as flat indices, (d, c) each."""
    half = np.maximum(_HALF * radii, 0.5)
    left, right = (np.clip(np.rint(columns + side), 0, size).astype(np.int64) for side in (-half, half))
    top, bottom = (np.clip(np.rint(rows + side), 0, size).astype(np.int64) for side in (-half, half))
    table = (np.arange(len(columns)) * (size + 1) ** 2)[:, None]
    return [
        table + row * (size + 1) + column
        for row, column in ((bottom, right), (top, left), (top, right), (bottom, left))
    ]


def _sums(worth: Floats, corners: list[NDArray[np.int64]]) -> Floats:
    """The sum of `worth` over each candidate's squares, (c,), by summed tables (F. Crow, 1984)."""
    table = np.zeros((len(worth), worth.shape[1] + 1, worth.shape[2] + 1), np.float32)
    np.cumsum(np.cumsum(worth, axis=1), axis=2, out=table[:, 1:, 1:])
    flat = table.ravel()
    a, b, c, d = (np.take(flat, corner) for corner in corners)
    sums: Floats = (a + b - c - d).sum(axis=0)
    return sums
