"""How far apart two pictures are."""

import numpy as np

from aoprecalc.measure.difference.difference import Difference, Pair, figure, unlike
from aoprecalc.measure.flip import flip
from aoprecalc.model import Floats

_NOTICED = 2 / 255  # of a pixel's difference
_ROUNDING = 1e-6  # of fractions of 255 in 32 bits, which must not count as more


def picture_difference(first: Floats, second: Floats) -> Difference:
    """Compare pictures, (h, w, channels) float32, all finite, channels >= 1, by the root mean square of second - first.

    Of several channels the one whose root mean square is greatest speaks for all. Where only one picture has several,
    the first channels are compared. Pictures of different sizes have nothing to compare.
    """
    if first.shape[:2] != second.shape[:2]:
        sizes = " and ".join(f"{picture.shape[1]} x {picture.shape[0]}" for picture in (first, second))
        return unlike(f"they have {sizes} pixels", Pair(first[:, :, 0], second[:, :, 0], None))
    said = []
    if first.shape[2] != second.shape[2]:
        said = [f"the pictures have {first.shape[2]} and {second.shape[2]} channels; the first of each are compared"]
    channels = min(first.shape[2], second.shape[2]) if not said else 1
    squares = [_mean_square(first[:, :, channel], second[:, :, channel]) for channel in range(channels)]
    channel = int(np.argmax(squares))
    one, other = first[:, :, channel], second[:, :, channel]
    seen = flip(one, other)
    apart = other.astype(np.float64) - one
    rms = float(np.sqrt(squares[channel]))
    details = {
        "width": first.shape[1],
        "height": first.shape[0],
        "channel": channel,
        "rms": figure(rms),
        "bias": figure(apart.mean()),
        "max": figure(np.abs(apart).max()),
        "share": figure(np.mean(np.abs(apart) > _NOTICED + _ROUNDING)),
        "flip": figure(np.mean(seen, dtype=np.float64)),
    }
    return Difference(rms, equal=rms == 0, details=details, pair=Pair(one, other, seen), warnings=tuple(said))


def _mean_square(first: Floats, second: Floats) -> float:
    return float(np.mean(np.square(second.astype(np.float64) - first)))
