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

from aoprecalc.progress import Progress
from aoprecalc.raster.layout import BLOCK, Samples, area_per_texel, texel_positions
from aoprecalc.raster.resolve import LeastSquaresImage
from aoprecalc.texture_lookup import bilinear
from aoprecalc.types import Float32Array, Float64Array, Int32Array, Int64Array, Texels
from aoprecalc.visibility.directions import MIN_SHADOW_SIZE, DirectionPlan
from aoprecalc.visibility.integrand import sampling_error
from aoprecalc.visibility.interleaving import GROUPS
from aoprecalc.visibility.setup import BakeSetup, SurfaceSide
from aoprecalc.visibility.source import LocalVisibility, TexelRequest

# Of the error of the resolution, that of sampling is to be at most this. Sharing makes the latter a quarter greater
# (measured), so that both together are up to 5% more than the former.
_SHARE = 0.25
_AXES = 16  # a packet of rays: the number of axes of a group is a multiple
_DIRECTIONS_PER_AXIS = 2

_MIN_BLOCKS, _MAX_BLOCKS = 8, 256  # in the pilot sample
_FEW = 4  # times the least number of blocks, below which a bake is fast anyway
_ONE_OF = 64  # blocks is in the sample: it takes a twentieth of the rays of a bake
_OFFSETS = range(5)  # groups at whose offsets its texels are sampled
_TAKEN = range(2)  # groups of axes that each of its samples takes
_GAP = 2  # texels between blocks, so that no look-up reads two
_CELL = BLOCK + 2 * _GAP  # texels a side, of a block among others


@dataclass(frozen=True)
class PilotErrors:
    """What a pilot sample tells of the errors of a texture, RMS.

    sampling     with a number of `directions`
    resolution   what look-ups between texels miss, however many directions there are: the least that is likely
    """

    sampling: float
    directions: int
    resolution: float

    def enough(self, plan: DirectionPlan, *, random: bool = False) -> DirectionPlan:
        """Return a plan with as many directions as pay, at most its own; the error of `random` ones falls as N^-1/2."""
        if not self.resolution:
            return plan
        ratio = self.sampling / (_SHARE * self.resolution)
        need = self.directions * math.pow(ratio, 2.0 if random else 4 / 3)
        step = GROUPS * _AXES * _DIRECTIONS_PER_AXIS
        return replace(plan, count=int(min(plan.count, step * max(1, math.ceil(need / step)))))


def enough_directions(setup: BakeSetup) -> DirectionPlan:
    """Return how many directions the texture of a setup is worth: at most as many as it has."""
    errors = pilot_errors(setup)
    if errors is None:
        return setup.directions
    return errors.enough(setup.directions, random=setup.inputs.options.sampling == "random")


def pilot_errors(setup: BakeSetup) -> PilotErrors | None:
    """Measure the errors on a pilot sample of the largest side; None where that has too few texels with a value."""
    side = max(setup.sides, key=lambda side: len(side.texels))
    rows, blocks = _pilot_texels(side.texels)
    if not len(rows):
        return None
    samples = _joined([setup.texel_samples(side, rows, group) for group in _OFFSETS])
    rows, blocks = np.tile(rows, len(_OFFSETS)), np.tile(blocks, len(_OFFSETS))
    source = LocalVisibility(setup, side, MIN_SHADOW_SIZE, len(rows), Progress())
    points = setup.measured(side, samples)
    sums = np.stack([source.visibility_sums(points, TexelRequest(group, rows)) for group in _TAKEN])
    taken = [setup.directions_of(group) for group in _TAKEN]
    sampling = sampling_error(sums, taken, setup.integrand, setup.inputs.options.sampling)
    values, measured = setup.integrand.estimate(sums.sum(axis=0), sum(taken))
    local = _positions_in_blocks(setup, side, samples, rows)
    # A sample of a face across the border of a repeating texture may lie elsewhere.
    used = np.flatnonzero(measured & (np.abs(local - BLOCK / 2) < _CELL / 2).all(axis=1))
    if sampling is None or not len(used):
        return None
    areas = area_per_texel(setup.textured(side), setup.inputs.atlas, side.texels)
    weights = areas[samples.faces[used]]
    resolution = _resolution_error(local[used], 1 - values[used], weights, blocks[used])
    return PilotErrors(sampling, sum(taken), resolution)


def _pilot_texels(texels: Texels) -> tuple[Int32Array, Int64Array]:
    """Return which texels are in the pilot sample, (n,), and the number of the block of each, (n,), from 0 on.

    None where there are too few blocks to tell anything of the whole.
    """
    row, column = np.divmod(texels.index.astype(np.int64), texels.width)
    block = row // BLOCK * (texels.width // BLOCK + 1) + column // BLOCK
    starts = np.flatnonzero(np.diff(block, prepend=-1))  # texels come block by block, see `order_in_blocks`
    lengths = np.diff(starts, append=len(block))
    count = max(_MIN_BLOCKS, min(len(starts) // _ONE_OF, _MAX_BLOCKS))
    if len(starts) < _FEW * _MIN_BLOCKS:
        return np.zeros(0, np.int32), np.zeros(0, np.int64)
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


def _resolution_error(local: Float32Array, values: Float32Array, weights: Float64Array, blocks: Int64Array) -> float:
    """Return what an image fitted to samples misses of them, RMS; of its square a standard error is taken off.

    local     (n, 2) positions in their blocks, which are laid out side by side in one image
    values, weights, blocks   (n,) of the samples
    Blocks differ more than the samples in them, so the standard error is that between blocks: what one block alone
    shows does not count. At other points the image misses more; the samples' own error makes up for that (measured).
    """
    count = int(blocks.max()) + 1
    across = math.ceil(math.sqrt(count))
    side = across * _CELL
    positions = local + (np.stack([blocks % across, blocks // across], axis=1) * _CELL + _GAP).astype(np.float32)
    image = LeastSquaresImage(side, side, repeats=False)
    image.add_samples(positions, values, weights)
    fitted = image.solve(image.mean_images()[0])
    uvs = np.stack([positions[:, 0], side - positions[:, 1]], axis=1).astype(np.float64) / side
    missed = values - bilinear(fitted, uvs, repeats=False)
    squares = np.bincount(blocks, weights * missed**2, count)
    totals = np.bincount(blocks, weights, count)
    mean = squares.sum() / totals.sum()
    deviation = math.sqrt(count / (count - 1) * float(((squares - mean * totals) ** 2).sum())) / totals.sum()
    return math.sqrt(max(mean - deviation, 0.0))
