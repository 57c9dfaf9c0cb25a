"""How many light directions a texture is worth: what a pilot sample of its texels tells before the bake.

The squared error of a texture as rendered has two parts. That of sampling falls as N^-3/2 with N directions. That of
the resolution, which lies between the texels, stays. Where the first is small beside the second, more directions do not
pay.

The pilot sample consists of whole blocks of texels, spread evenly over the texture. In these several points of each
texel take the same directions, and an image is fitted to them, as in a bake. What it misses, the resolution leaves.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from aoprecalc.progress import Progress
from aoprecalc.raster.layout import BLOCK, Samples, texel_positions
from aoprecalc.raster.resolve import LeastSquaresImage
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Float32Array, Float64Array, Int32Array, Int64Array, Texels
from aoprecalc.visibility.directions import MIN_SHADOW_SIZE, DirectionPlan
from aoprecalc.visibility.integrand import error_per_difference
from aoprecalc.visibility.interleaving import GROUPS
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide
from aoprecalc.visibility.source import LocalVisibility, TexelRequest

# Of the error of the resolution, that of sampling is to be at most this. Sharing makes the latter a quarter greater
# (measured), so that both together are about 5% more than the former.
_SHARE = 0.25
_LEAST_ERROR = 1e-6  # below it is rounding
_STEP = 2 * GROUPS * 16  # directions: a group has as many axes as a packet has rays, or a multiple

_ONE_OF = 64  # blocks is in the pilot sample: that takes 3 to 7% of the rays of a bake with 1152 directions
_MIN_BLOCKS, _MAX_BLOCKS = 8, 256  # in it: fewer tell little, and a bake of so small a texture is fast
_MAX_DOUBT = 0.5  # standard error of the squared error of the resolution, relative: else a few blocks decide
_OFFSETS = range(3)  # groups at whose offsets its texels are sampled
_TAKEN = range(2)  # groups of axes that each of its samples takes
_GAP = 2  # texels between blocks, so that no look-up reads two
_CELL = BLOCK + 2 * _GAP  # texels a side, of a block among others


@dataclass(frozen=True)
class PilotErrors:
    """What a pilot sample tells of the errors of a texture, RMS as rendered.

    resolution   what look-ups between texels miss, however many directions there are
    sampling     with a number of `directions`: the most that is likely beside that of the resolution
    """

    resolution: float
    sampling: float
    directions: int

    def enough(self, plan: DirectionPlan, *, random: bool = False) -> DirectionPlan:
        """Return a plan with as many directions as are enough, at most its own.

        random   their error falls as N^-1/2
        """
        if min(self.sampling, self.resolution) < _LEAST_ERROR:
            return plan
        ratio = self.sampling / (_SHARE * self.resolution)
        need = self.directions * math.pow(ratio, 2.0 if random else 4 / 3)
        return replace(plan, count=int(min(plan.count, _STEP * max(1, math.ceil(need / _STEP)))))


def enough_directions(setup: BakeSetup) -> DirectionPlan:
    """Return how many directions the texture of a setup is worth, by its most demanding side.

    They are at most its own, and these where a side does not tell.
    """
    plan, random = setup.directions, setup.inputs.options.sampling == "random"
    sides = [pilot_errors(setup, side) for side in setup.sides]
    plans = [plan if errors is None else errors.enough(plan, random=random) for errors in sides]
    return max(plans, key=lambda plan: plan.count)


def pilot_errors(setup: BakeSetup, side: SurfaceSide) -> PilotErrors | None:
    """Measure the errors on a pilot sample of a side; None where few blocks have values, or a few of these decide."""
    rows, blocks = _pilot_texels(side.texels)
    if not len(rows):
        return None
    samples = _joined([setup.texel_samples(side, rows, group) for group in _OFFSETS])
    rows, blocks = np.tile(rows, len(_OFFSETS)), np.tile(blocks, len(_OFFSETS))
    source = LocalVisibility(setup, side, MIN_SHADOW_SIZE, len(rows), Progress())
    points = setup.measured(side, samples)
    halves = [source.visibility_sums(points, TexelRequest(group, rows)) for group in _TAKEN]
    taken = [setup.directions_of(group) for group in _TAKEN]
    integrand = setup.integrand
    (first, in_first), (second, in_second) = map(integrand.estimate, halves, taken)
    values, _ = integrand.estimate(halves[0] + halves[1], sum(taken))
    local = _positions_in_blocks(setup, side, samples, rows)
    # A sample of a face across the border of a repeating texture may lie elsewhere.
    used = np.flatnonzero(in_first & in_second & (np.abs(local - BLOCK / 2) < _CELL / 2).all(axis=1))
    with_values, blocks = np.unique(blocks[used], return_inverse=True)
    if len(with_values) < _MIN_BLOCKS:
        return None
    weights = setup.area_per_texel(side.texels)[samples.faces[used]]
    if not weights.any():
        return None
    difference = (first - second)[used] * error_per_difference(taken, setup.inputs.options.sampling)
    missed = _missed(local[used], 1 - values[used], weights, blocks)
    errors = _errors_of_blocks(missed, difference, weights, blocks)
    return None if errors is None else PilotErrors(*errors, sum(taken))


def _pilot_texels(texels: Texels) -> tuple[Int32Array, Int64Array]:
    """Return which texels are in the pilot sample, (n,), and the number of the block of each, (n,), from 0 on.

    Both are empty where there are too few blocks.
    """
    row, column = np.divmod(texels.index, np.int32(texels.width))
    block = row // BLOCK * np.int32(texels.width // BLOCK + 1) + column // BLOCK
    starts = np.flatnonzero(np.diff(block, prepend=-1))  # texels come block by block, see `order_in_blocks`
    count = min(len(starts) // _ONE_OF, _MAX_BLOCKS)
    if count < _MIN_BLOCKS:
        return np.zeros(0, np.int32), np.zeros(0, np.int64)
    lengths = np.diff(starts, append=len(block))
    chosen = (2 * np.arange(count) + 1) * len(starts) // (2 * count)
    rows = np.concatenate([np.arange(starts[at], starts[at] + lengths[at], dtype=np.int32) for at in chosen])
    return rows, np.repeat(np.arange(count), lengths[chosen])


def _joined(samples: list[Samples]) -> Samples:
    """Return samples after each other."""
    return Samples(np.concatenate([some.faces for some in samples]), np.concatenate([some.weights for some in samples]))


def _positions_in_blocks(setup: BakeSetup, side: SurfaceSide, samples: Samples, rows: Int32Array) -> Float32Array:
    """Return the positions of samples of a side's texels, (n, 2) in texels, from the corners of their blocks."""
    index = side.texels.index[rows]
    corners = np.stack(np.divmod(index, np.int32(side.texels.width))[::-1], axis=1) // BLOCK * BLOCK
    local: Float32Array = (texel_positions(setup.inputs.atlas, side.texels, samples) - corners).astype(np.float32)
    return local


def _missed(
    local: Float32Array, values: Float32Array, weights: Float64Array, blocks: Int64Array
) -> NDArray[np.floating]:
    """Return what an image fitted to samples misses of each of them, (n,).

    local     (n, 2) positions in their blocks, which are laid out side by side in one image
    values, weights, blocks   (n,) of the samples
    At other points the image misses more. The samples' own error, which it misses too, makes up for that (measured).
    """
    across = math.ceil(math.sqrt(blocks.max() + 1))
    side = across * _CELL
    positions = local + (np.stack([blocks % across, blocks // across], axis=1) * _CELL + _GAP).astype(np.float32)
    image = LeastSquaresImage(side, side, repeats=False)
    image.add_samples(positions, values, weights)
    fitted = image.solve(image.mean_images()[0])
    uvs = np.stack([positions[:, 0], side - positions[:, 1]], axis=1).astype(np.float64) / side
    return values - bilinear(fitted, uvs, repeats=False)


def _errors_of_blocks(
    missed: NDArray[np.floating], difference: NDArray[np.floating], weights: Float64Array, blocks: Int64Array
) -> tuple[float, float] | None:
    """Return the errors of the resolution and of sampling, see `PilotErrors`; None where the first is too uncertain.

    missed, difference   (n,) the errors of the samples
    weights, blocks      (n,) of the samples
    Standard errors are those between blocks, which differ most. Blocks with more of one error have more of the other,
    too, so the quotient of both is more certain than each of them.
    """
    by_resolution, by_sampling, totals = (
        np.asarray(np.bincount(blocks, of_samples), np.float64)
        for of_samples in (weights * missed**2, weights * difference**2, weights)
    )
    resolution = float(by_resolution.sum() / totals.sum())
    if not resolution or _standard_error(by_resolution, totals) > _MAX_DOUBT * resolution:
        return None
    quotient = by_sampling.sum() / by_resolution.sum() + _standard_error(by_sampling, by_resolution)
    return math.sqrt(resolution), math.sqrt(resolution * quotient)


def _standard_error(values: Float64Array, weights: Float64Array) -> float:
    """Return the standard error of the quotient of the sums of values and of weights, (b,) of blocks that were drawn.

    (W. G. Cochran, "Sampling Techniques", 1977, chapter 6: ratio estimators.)
    """
    differences = values - values.sum() / weights.sum() * weights
    spread = float((differences**2).sum()) * len(values) / (len(values) - 1)
    return math.sqrt(spread) / float(weights.sum())
