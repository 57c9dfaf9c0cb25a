"""Differences between two pictures, two meshes with ambient occlusion, or two JSON documents."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from aoprecalc.errors import counted, one_or_many
from aoprecalc.metrics.flip import flip
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


# JSON documents.

IGNORED_KEYS = frozenset({"seconds", "version", "renderer", "path", "outputs"})  # depend on the time or the machine
_MAX_LISTED = 10  # differing leaves in the details

_MISSING = object()


def document_difference(first: Any, second: Any) -> Difference:
    """Compare JSON documents leaf by leaf, except what is under a key of IGNORED_KEYS.

    The value is the maximum of |a - b| / max(1, |a|, |b|) over numbers. Documents that differ in anything else, such as
    texts, keys or the lengths of lists, are incomparable.
    """
    numbers, value, places, others = 0, 0.0, [], []
    for path, a, b in _leaves(first, second):
        difference = _leaf_difference(a, b)
        numbers += _is_number(a) and _is_number(b)
        if difference != 0:
            value = max(value, difference or 0.0)
            places.append({"at": path, "a": _leaf_summary(a), "b": _leaf_summary(b)})
            others += [path] if difference is None else []
    details = {
        "numbers": numbers,
        "differing": len(places),
        "value": rounded(value),
        "places": places[:_MAX_LISTED],
    }
    if others:
        count = f"{counted(len(others), 'place')} {one_or_many(len(others), 'differs', 'differ')}"
        return incomparable(f"{count} in more than a number, the first at {others[0]}", None, **details)
    return Difference(value, equal=not places, details=details)


def _leaves(first: Any, second: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the path of each leaf and its value in either document, in the order of the first.

    Lists of different lengths and values that only one document has are leaves.
    """
    stack: list[tuple[str, Any, Any]] = [("", first, second)]  # no recursion, as documents may be nested deeply
    while stack:
        path, a, b = stack.pop()
        if isinstance(a, dict) and isinstance(b, dict):
            keys = [key for key in {**a, **b} if key not in IGNORED_KEYS]
            children = [(f"{path}.{key}".lstrip("."), a.get(key, _MISSING), b.get(key, _MISSING)) for key in keys]
            stack += reversed(children)
        elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
            stack += reversed([(f"{path}[{index}]", *items) for index, items in enumerate(zip(a, b, strict=True))])
        else:
            yield path, a, b


def _leaf_difference(a: Any, b: Any) -> float | None:
    """Return the relative difference of two leaves; None if they differ and are not both finite numbers."""
    if _is_number(a) and _is_number(b):
        if a == b:
            return 0.0
        try:
            difference = abs(a - b) / max(1, abs(a), abs(b))
        except OverflowError:  # integers may have any number of digits
            return None
        return float(difference) if math.isfinite(difference) else None
    return 0.0 if type(a) is type(b) and a == b else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _leaf_summary(value: Any) -> Any:
    """Return a leaf for a report: containers by their size, long texts cut, None if it is missing."""
    if value is _MISSING:
        return None
    if isinstance(value, dict | list):
        return counted(len(value), "key" if isinstance(value, dict) else "value")
    if isinstance(value, str):
        return value if len(value) <= 80 else f"{value[:77]}..."
    return value
