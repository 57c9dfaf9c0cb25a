"""Differences between two pictures, with FLIP, and between two meshes with ambient occlusion."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.ndimage import correlate1d

from aoprecalc.types import BoolArray, Float32Array, Float64Array

Answer = Literal["equal", "near", "different"]


@dataclass(frozen=True, eq=False)
class PicturePair:
    """Two compared pictures of one channel each.

    first, second   (h, w) float32, row 0 on top; their sizes may differ
    flip            (h, w) float32 in [0, 1]: perceived difference; None if the sizes differ
    """

    first: Float32Array
    second: Float32Array
    flip: Float32Array | None


@dataclass(frozen=True, eq=False)
class Difference:
    """The difference of B from A.

    value      compared with a tolerance, >= 0; None if A and B are not comparable by a number
    equal      all compared values are identical
    reason     why they are not comparable; empty if they are
    details    other measurements, as plain JSON values
    pair       the compared pictures; None if there are none
    warnings   messages to the user about the comparison
    """

    value: float | None
    equal: bool = False
    reason: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    pair: PicturePair | None = None
    warnings: tuple[str, ...] = ()

    def answer(self, tolerance: float) -> Answer:
        """Classify the difference: "near" if its value is at most `tolerance`."""
        if self.equal:
            return "equal"
        return "near" if self.value is not None and self.value <= tolerance else "different"


def incomparable(reason: str, pair: PicturePair | None = None, **details: Any) -> Difference:
    """Return the difference of two results that cannot be compared by a number."""
    return Difference(None, reason=reason, details=details, pair=pair)


def rounded(value: float | np.floating[Any]) -> float:
    """Round a measurement to six significant digits, as in reports."""
    return float(f"{value:.6g}")


def scaled_to_unit(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Divide two finite arrays by the power of two that brings both into [-1, 1], so that squares do not overflow."""
    exponent = np.frexp(max(np.abs(first).max(), np.abs(second).max()))[1]
    return np.ldexp(first, -exponent), np.ldexp(second, -exponent)


def bounding_diagonal(points: Float64Array) -> float:
    """Return the bounding box diagonal of points, (..., 3) in [-1, 1]; 1 if all points coincide."""
    return float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0))) or 1.0


# Pictures.

_NOTICEABLE = 2 / 255  # difference of a pixel that counts in `share`
_ROUNDING = 1e-6  # of multiples of 1/255 in float32
_ROUNDED_UVS = 0.01  # share of the covered texels that rounding of UVs, as by formats, may change


@dataclass(frozen=True, eq=False)
class ComparedTexture:
    """A texture of ambient occlusion.

    pixels    (h, w, channels) float32, finite, channels >= 1
    covered   (h, w) bool: the texels that the surface covers, at least one; None where that is not known
    """

    pixels: Float32Array
    covered: BoolArray | None = None


def picture_difference(first: ComparedTexture, second: ComparedTexture) -> Difference:
    """Compare textures by the root mean square of second - first, over the texels that either surface covers.

    Padding and fill count only where neither surface is known; the details tell the whole picture too. The value is
    that of the channel with the greatest RMS. If the numbers of channels differ, only the first channels are compared.
    Pictures of different sizes are incomparable.
    """
    one, other = first.pixels, second.pixels
    if one.shape[:2] != other.shape[:2]:
        sizes = " and ".join(f"{pixels.shape[1]} x {pixels.shape[0]}" for pixels in (one, other))
        return incomparable(f"they have {sizes} pixels", PicturePair(one[:, :, 0], other[:, :, 0], None))
    counts = one.shape[2], other.shape[2]
    warnings = []
    if counts[0] != counts[1]:
        warnings = [f"the pictures have {counts[0]} and {counts[1]} channels; only the first channels are compared"]
    surface, notes = _surface(first.covered, second.covered)
    counted = np.s_[:] if surface is None else surface
    channels = counts[0] if counts[0] == counts[1] else 1
    mean_squares = [_mean_square(one[..., index][counted], other[..., index][counted]) for index in range(channels)]
    channel = int(np.argmax(mean_squares))
    a, b = one[:, :, channel], other[:, :, channel]
    flip_map = flip(a, b)
    difference = b.astype(np.float64) - a
    rms = float(np.sqrt(mean_squares[channel]))
    details = {
        "width": one.shape[1],
        "height": one.shape[0],
        "channel": channel,
        "surface": None if surface is None else _statistics(difference[surface], flip_map[surface]),
        "picture": _statistics(difference, flip_map),
    }
    return Difference(
        rms,
        equal=not difference.any(),
        details=details,
        pair=PicturePair(a, b, flip_map),
        warnings=(*warnings, *notes),
    )


def _surface(first: BoolArray | None, second: BoolArray | None) -> tuple[BoolArray | None, list[str]]:
    """Return the texels that either surface covers, None where neither is known, and a warning where they differ.

    A texel that only one of them covers counts: there the other has padding or fill, which a viewer would see.
    """
    if first is None or second is None:
        return (second if first is None else first), []
    either: BoolArray = first | second
    apart = float(np.count_nonzero(first != second) / np.count_nonzero(either))
    if apart <= _ROUNDED_UVS:
        return either, []
    return either, [
        f"{apart:.1%} of the texels lie on the surface of A or B alone: they have different UVs, so that texels of "
        "different places are compared; bake both with the same UVs"
    ]


def _statistics(difference: Float64Array, flip_map: Float32Array) -> dict[str, float]:
    """Return what is told of differences, with their FLIP, of any one shape."""
    return {
        "texels": difference.size,
        "rms": rounded(np.sqrt(np.mean(np.square(difference)))),
        "bias": rounded(difference.mean()),
        "max": rounded(np.abs(difference).max()),
        "share": rounded(np.mean(np.abs(difference) > _NOTICEABLE + _ROUNDING)),
        "flip": rounded(np.mean(flip_map, dtype=np.float64)),
    }


def _mean_square(first: Float32Array, second: Float32Array) -> float:
    return float(np.mean(np.square(second.astype(np.float64) - first)))


# Meshes with ambient occlusion.


@dataclass(frozen=True, eq=False)
class ComparedMesh:
    """The compared properties of a mesh.

    corners       (f, 3, 3) float64, finite, f >= 1: positions of each face's corners
    normals       (f, 3, 3) float32, unit length, at the corners; None if the file has none
    uv_sets       all UV sets of the file, each (f, 3, 2) float64
    texture       the ambient occlusion, of one channel; None if there is none
    texture_uvs   (f, 3, 2) float64: the UVs of the texture; NaN on faces that it does not cover
    """

    corners: Float64Array
    normals: Float32Array | None
    uv_sets: tuple[Float64Array, ...]
    texture: ComparedTexture | None = None
    texture_uvs: Float64Array | None = None


def mesh_difference(first: ComparedMesh, second: ComparedMesh) -> Difference:
    """Compare meshes corner by corner, in the order of their files, and their textures.

    The value is the maximum of: distances of positions / bounding box diagonal of both meshes; distances of UVs;
    lengths of the differences of normals; the RMS difference of the textures over the texels that the surface covers.
    """
    textures = None
    if first.texture is not None and second.texture is not None:
        textures = picture_difference(first.texture, second.texture)
    pair = None if textures is None else textures.pair
    reason = _mismatch(first, second) or ("" if textures is None else textures.reason)
    if reason:
        return incomparable(reason, pair)
    corners = scaled_to_unit(first.corners, second.corners)
    position = _max_distance(*corners) / bounding_diagonal(np.stack(corners))
    uvs = [_max_distance(*sets) for sets in zip(first.uv_sets, second.uv_sets, strict=True)]
    if first.texture_uvs is not None and second.texture_uvs is not None:
        uvs.append(_max_distance(first.texture_uvs, second.texture_uvs))
    normal = None
    if first.normals is not None and second.normals is not None:
        normal = _max_distance(first.normals, second.normals)
    value = max(position, *uvs, normal or 0.0, 0.0 if textures is None else textures.value or 0.0)
    details = {
        "triangles": len(first.corners),
        "position": rounded(position),
        "uv": rounded(max(uvs)) if uvs else None,
        "normal": None if normal is None else rounded(normal),
        "texture": None if textures is None else textures.details,
    }
    equal = value == 0 and (textures is None or textures.equal)
    warnings = () if textures is None else textures.warnings
    return Difference(value, equal=equal, details=details, pair=pair, warnings=warnings)


def _mismatch(first: ComparedMesh, second: ComparedMesh) -> str:
    """Say why the meshes cannot be compared corner by corner; return an empty text if they can."""
    if len(first.corners) != len(second.corners):
        return f"they have {len(first.corners)} and {len(second.corners)} triangles"
    for name, present in {
        "a picture of ambient occlusion": [mesh.texture is not None for mesh in (first, second)],
        "normals": [mesh.normals is not None for mesh in (first, second)],
    }.items():
        if present[0] != present[1]:
            return f"only {'A' if present[0] else 'B'} has {name}"
    if len(first.uv_sets) != len(second.uv_sets):
        return f"they have {len(first.uv_sets)} and {len(second.uv_sets)} sets of UVs"
    if first.texture_uvs is not None and second.texture_uvs is not None:
        covered = [~np.isnan(uvs).any(axis=(1, 2)) for uvs in (first.texture_uvs, second.texture_uvs)]
        if (covered[0] != covered[1]).any():
            return (
                f"their pictures lie on {covered[0].sum()} and {covered[1].sum()} triangles, not all of them the same"
            )
    return ""


def _max_distance(first: Float64Array | Float32Array, second: Float64Array | Float32Array) -> float:
    """Return the maximum distance of corresponding points, (..., d); pairs with NaN count as 0."""
    with np.errstate(over="ignore"):  # UVs may be of any size
        distances = np.linalg.norm(second.astype(np.float64) - first, axis=-1)
    return float(np.nan_to_num(distances, nan=0.0).max())


# FLIP, a perceptual difference of two pictures shown in alternation, for grey pictures: Andersson, Nilsson,
# Akenine-Möller, Oskarsson, Åström, Fairchild, FLIP: A Difference Evaluator for Alternating Images, 2020, for low
# dynamic range. Both opponent colour channels of a grey picture are 0 before and after any filter, so only the
# achromatic channel remains.

PIXELS_PER_DEGREE = 67  # of visual angle: a display 0.7 m wide, of 3840 pixels, at a distance of 0.7 m

_CSF_B = 0.0047  # contrast sensitivity of the achromatic channel: the paper's b1, in square degrees
_MAX_CSF_B = 0.04  # the same of the blue-yellow channel, which determines the filter size of all channels
_FEATURE_WIDTH = 0.082  # degrees, of the edges and points that are detected
_QC, _QF = 0.7, 0.5  # exponents of colour and feature differences
_PC, _PT = 0.4, 0.95  # knee of the colour error: fraction of the maximum difference, and the error assigned to it
_CMAX = 41.27610  # HyAB distance of Hunt-adjusted green and blue, to the power q_c: the paper's c_max
_CHUNK_ROWS = 512  # processed at once, to bound memory


def flip(first: Float32Array, second: Float32Array, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Float32Array:
    """Return the perceived difference of two pictures at each pixel, (h, w) float32 in [0, 1].

    first, second       (h, w), finite, linear grey; clamped to [0, 1]
    pixels_per_degree   > 0: of visual angle

    The difference of black and white is 0.967: only saturated colours reach 1. FLIP is symmetric.
    """
    csf = _gaussian(np.sqrt(_CSF_B / 2) / np.pi, 3 * np.sqrt(_MAX_CSF_B / 2) / np.pi, pixels_per_degree)
    feature_sigma = _FEATURE_WIDTH / 2
    gaussian = _gaussian(feature_sigma, 3 * feature_sigma, pixels_per_degree)
    edge, point = _edge_kernel(gaussian), _point_kernel(gaussian, feature_sigma * pixels_per_degree)
    halo = max(len(csf), len(gaussian)) // 2
    result = np.empty(first.shape, np.float32)
    for start in range(0, len(first), _CHUNK_ROWS):
        top = max(0, start - halo)
        rows = slice(top, start + _CHUNK_ROWS + halo)
        a, b = (np.clip(picture[rows].astype(np.float64), 0, 1) for picture in (first, second))
        colour = _colour_difference(a, b, csf)
        feature = np.maximum(
            np.abs(_feature_magnitude(a, edge, gaussian) - _feature_magnitude(b, edge, gaussian)),
            np.abs(_feature_magnitude(a, point, gaussian) - _feature_magnitude(b, point, gaussian)),
        )
        feature = np.clip(feature / np.sqrt(2), 0, 1) ** _QF
        result[start : start + _CHUNK_ROWS] = (colour ** (1 - feature))[start - top :][:_CHUNK_ROWS]
    return result


def _colour_difference(first: Float64Array, second: Float64Array, csf: Float64Array) -> Float64Array:
    """Return the colour difference of pictures, (h, w) in [0, 1], after the contrast sensitivity filter."""
    a, b = (_lightness(_filter(picture, csf, csf)) for picture in (first, second))
    power = np.abs(a - b) ** _QC
    knee = _PC * _CMAX
    above = _PT + (power - knee) / (_CMAX - knee) * (1 - _PT)
    difference: Float64Array = np.where(power < knee, power * (_PT / knee), above)
    return difference


def _feature_magnitude(picture: Float64Array, kernel: Float64Array, gaussian: Float64Array) -> Float64Array:
    """Return the magnitude of edges or points in a picture, (h, w), in any direction."""
    return np.hypot(_filter(picture, kernel, gaussian), _filter(picture, gaussian, kernel))


def _filter(picture: Float64Array, x_kernel: Float64Array, y_kernel: Float64Array) -> Float64Array:
    """Filter a picture by a separable kernel; pixels outside repeat the border."""
    rows: Float64Array = correlate1d(picture, x_kernel, axis=1, mode="nearest")
    filtered: Float64Array = correlate1d(rows, y_kernel, axis=0, mode="nearest")
    return filtered


def _lightness(luminance: Float64Array) -> Float64Array:
    """Return CIE L*, 0 to 100, of linear luminance, 0 to 1."""
    delta = 6 / 29
    root = np.where(luminance > delta**3, np.cbrt(luminance), luminance / (3 * delta**2) + 4 / 29)
    lightness: Float64Array = 116 * root - 16
    return lightness


def _gaussian(sigma: float, radius: float, pixels_per_degree: float) -> Float64Array:
    """Return a Gaussian kernel of sum 1; `sigma` and `radius` are in degrees."""
    x = _offsets(int(np.ceil(radius * pixels_per_degree))) / pixels_per_degree
    weights = np.exp(-(x**2) / (2 * sigma**2))
    gaussian: Float64Array = weights / weights.sum()
    return gaussian


def _edge_kernel(gaussian: Float64Array) -> Float64Array:
    """Return the first derivative of a Gaussian, scaled so that positive weights sum to 1 and negative ones to -1."""
    return _balanced(-_offsets(len(gaussian) // 2) * gaussian)


def _point_kernel(gaussian: Float64Array, sigma: float) -> Float64Array:
    """Return the second derivative of a Gaussian, `sigma` in pixels, scaled in the same way."""
    return _balanced(((_offsets(len(gaussian) // 2) / sigma) ** 2 - 1) * gaussian)


def _offsets(radius: int) -> Float64Array:
    """Return the offsets of a kernel's weights from its centre, in pixels."""
    return np.arange(-radius, radius + 1, dtype=np.float64)


def _balanced(weights: Float64Array) -> Float64Array:
    positive, negative = weights.clip(min=0), weights.clip(max=0)
    balanced: Float64Array = positive / positive.sum() - negative / negative.sum()
    return balanced
