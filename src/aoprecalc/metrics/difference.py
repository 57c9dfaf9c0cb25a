"""What a comparison finds, whatever was compared."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from aoprecalc.metrics.flip import flip
from aoprecalc.types import Float32Array, Float64Array

Answer = Literal["equal", "near", "different"]


@dataclass(frozen=True, eq=False)
class PicturePair:
    """Two pictures to be looked at, of one channel each.

    first, second   (h, w) float32, row 0 on top; they may have different sizes
    flip            (h, w) float32 in [0, 1]: what an eye sees of the difference; None where the sizes differ
    """

    first: Float32Array
    second: Float32Array
    flip: Float32Array | None


@dataclass(frozen=True, eq=False)
class Difference:
    """How far B is from A.

    value      the number that a tolerance is held against, >= 0; None where no number can tell
    equal      every value that was compared is the same
    reason     why no number can tell, in words; empty where one can
    details    what else was measured: plain JSON values
    pair       the pictures that were compared; None where there are none
    warnings   what the user should know about the comparison
    """

    value: float | None
    equal: bool = False
    reason: str = ""
    details: dict[str, Any] = field(default_factory=dict)
    pair: PicturePair | None = None
    warnings: tuple[str, ...] = ()

    def answer(self, tolerance: float) -> Answer:
        """Return what the difference means where at most `tolerance` is allowed."""
        if self.equal:
            return "equal"
        return "near" if self.value is not None and self.value <= tolerance else "different"


def incomparable(reason: str, pair: PicturePair | None = None, **details: Any) -> Difference:
    """Return the difference of what cannot be laid on one another, for a reason in words."""
    return Difference(None, reason=reason, details=details, pair=pair)


def rounded(value: float | np.floating[Any]) -> float:
    """Return a measured number as documents show it, with six digits."""
    return float(f"{value:.6g}")


def scaled_to_unit(first: Float64Array, second: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return two arrays of finite numbers, divided by a power of two so that none is beyond 1: squares are finite."""
    exponent = np.frexp(max(np.abs(first).max(), np.abs(second).max()))[1]
    return np.ldexp(first, -exponent), np.ldexp(second, -exponent)


def bounding_diagonal(points: Float64Array) -> float:
    """Return the diagonal of the box around points, (..., 3), none of them beyond 1; 1 where they are all the same."""
    return float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0))) or 1.0


# How far apart two pictures are.

_NOTICED = 2 / 255  # of a pixel's difference
_ROUNDING = 1e-6  # of fractions of 255 in 32 bits, which must not count as more


def picture_difference(first: Float32Array, second: Float32Array) -> Difference:
    """Compare pictures, (h, w, channels) float32, all finite, channels >= 1, by the root mean square of second - first.

    Of several channels the one whose root mean square is greatest speaks for all. Where only one picture has several,
    the first channels are compared. Pictures of different sizes have nothing to compare.
    """
    if first.shape[:2] != second.shape[:2]:
        sizes = " and ".join(f"{picture.shape[1]} x {picture.shape[0]}" for picture in (first, second))
        return incomparable(f"they have {sizes} pixels", PicturePair(first[:, :, 0], second[:, :, 0], None))
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
        "rms": rounded(rms),
        "bias": rounded(apart.mean()),
        "max": rounded(np.abs(apart).max()),
        "share": rounded(np.mean(np.abs(apart) > _NOTICED + _ROUNDING)),
        "flip": rounded(np.mean(seen, dtype=np.float64)),
    }
    return Difference(rms, equal=rms == 0, details=details, pair=PicturePair(one, other, seen), warnings=tuple(said))


def _mean_square(first: Float32Array, second: Float32Array) -> float:
    return float(np.mean(np.square(second.astype(np.float64) - first)))


# How far apart two meshes with ambient occlusion are.


@dataclass(frozen=True, eq=False)
class ComparedMesh:
    """What is compared of a mesh.

    corners       (f, 3, 3) float64, finite, f >= 1: the positions of each face's corners
    normals       (f, 3, 3) float32, unit length, at the corners; None where the file has none
    uv_sets       those of the file, each (f, 3, 2) float64
    picture       (h, w, 1) float32, finite: the ambient occlusion; None where there is none
    picture_uvs   (f, 3, 2) float64: how it lies on the mesh, one of the sets or made from it; NaN where it does not
    """

    corners: Float64Array
    normals: Float32Array | None
    uv_sets: tuple[Float64Array, ...]
    picture: Float32Array | None = None
    picture_uvs: Float64Array | None = None


def mesh_difference(first: ComparedMesh, second: ComparedMesh) -> Difference:
    """Compare meshes corner by corner, in the order in which their files have them, and their pictures.

    The value is the greatest of: how far a position has moved, over the diagonal of the box around both meshes; how far
    a UV has moved; the length of the difference of two normals; the pictures' root mean square.
    """
    pictures = None
    if first.picture is not None and second.picture is not None:
        pictures = picture_difference(first.picture, second.picture)
    pair = None if pictures is None else pictures.pair
    reason = _unlike(first, second) or ("" if pictures is None else pictures.reason)
    if reason:
        return incomparable(reason, pair)
    corners = scaled_to_unit(first.corners, second.corners)
    moved = _farthest(*corners) / bounding_diagonal(np.stack(corners))
    uvs = [_farthest(*sets) for sets in zip(first.uv_sets, second.uv_sets, strict=True)]
    if first.picture_uvs is not None and second.picture_uvs is not None:
        uvs.append(_farthest(first.picture_uvs, second.picture_uvs))
    normals = None
    if first.normals is not None and second.normals is not None:
        normals = _farthest(first.normals, second.normals)
    value = max(moved, *uvs, normals or 0.0, 0.0 if pictures is None else pictures.value or 0.0)
    details = {
        "triangles": len(first.corners),
        "position": rounded(moved),
        "uv": rounded(max(uvs)) if uvs else None,
        "normal": None if normals is None else rounded(normals),
        "texture": None if pictures is None else pictures.details,
    }
    return Difference(value, equal=value == 0, details=details, pair=pair)


def _unlike(first: ComparedMesh, second: ComparedMesh) -> str:
    """Say why the meshes cannot be laid on one another; nothing where they can."""
    if len(first.corners) != len(second.corners):
        return f"they have {len(first.corners)} and {len(second.corners)} triangles"
    for name, has in {
        "a picture of ambient occlusion": [surface.picture is not None for surface in (first, second)],
        "normals": [surface.normals is not None for surface in (first, second)],
    }.items():
        if has[0] != has[1]:
            return f"only {'A' if has[0] else 'B'} has {name}"
    if len(first.uv_sets) != len(second.uv_sets):
        return f"they have {len(first.uv_sets)} and {len(second.uv_sets)} sets of UVs"
    if first.picture_uvs is not None and second.picture_uvs is not None:
        places = [~np.isnan(surface).any(axis=(1, 2)) for surface in (first.picture_uvs, second.picture_uvs)]
        if (places[0] != places[1]).any():
            return f"their pictures lie on {places[0].sum()} and {places[1].sum()} triangles, not all of them the same"
    return ""


def _farthest(first: Float64Array | Float32Array, second: Float64Array | Float32Array) -> float:
    """Return the greatest distance between two arrays' points, (..., d); places without a point count as 0."""
    with np.errstate(over="ignore"):  # UVs may be of any size
        away = np.linalg.norm(second.astype(np.float64) - first, axis=-1)
    return float(np.nan_to_num(away, nan=0.0).max())
