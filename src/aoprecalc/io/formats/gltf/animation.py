"""Animations of glTF: the document with its nodes where a clip stands at a time.

A channel of a clip changes one property of a node: translation, rotation, scale, or the weights of morph targets. All
else of the document stays as it is, so that the reader of the rest pose reads any pose.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from aoprecalc.errors import ArgumentError, nearest
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.gltf.document import GltfDocument, Json, float_values
from aoprecalc.types import Float64Array

_PROPERTIES = ("translation", "rotation", "scale", "weights")
_CLOSE = 1e-5  # by which a time may lie beyond the end of a clip, as key times are 32-bit floats and people round
_PARALLEL = 1 - 1e-9  # cosine from which two quaternions are interpolated linearly


def posed_document(document: GltfDocument, pose: str) -> tuple[GltfDocument, tuple[str, ...]]:
    """Return a document whose nodes stand where a clip is at a time, and warnings.

    pose   such as walk@0.5: the name of the clip, or its number, and seconds
    Raises ArgumentError where there is no such clip or no such time, InputError where the clip is damaged.
    """
    name, _, seconds = pose.rpartition("@")
    clip = _clip(document, pose, name)
    time = float(seconds)
    end = max((float(_times(document, sampler)[-1]) for sampler in clip["samplers"]), default=0.0)
    if time > end + _CLOSE * max(1.0, end):
        found = f"has {pose!r}, but {name!r} of {document.path} lasts from 0 to {end:g} seconds"
        raise ArgumentError("pose", f"{found}; use a time within")
    nodes = [dict(node) for node in document.json.get("nodes", [])]
    ignored = list[str]()
    for channel in clip["channels"]:
        target = channel["target"]
        if target["path"] not in _PROPERTIES:
            ignored.append(target.get("extensions", {}).get("KHR_animation_pointer", {}).get("pointer", target["path"]))
        elif "node" in target:
            node, path = document.entry("nodes", number := target["node"]), target["path"]
            if "matrix" in node and path != "weights":
                raise damaged_file(
                    document.path, f"node {number} has a matrix and an animated {path}, one was expected"
                )
            nodes[number][path] = _value(document, clip["samplers"][channel["sampler"]], path, time).tolist()
    return replace(document, json={**document.json, "nodes": nodes}), tuple(_warnings(pose, ignored))


def _warnings(pose: str, ignored: list[str]) -> Iterator[str]:
    if ignored:
        what = ", ".join(dict.fromkeys(ignored))
        yield f"pose {pose!r}: the clip also animates {what} (KHR_animation_pointer), which has no effect on the bake"


def _clip(document: GltfDocument, pose: str, name: str) -> Json:
    """Return the animation of a name or number."""
    clips: list[Json] = document.json.get("animations", [])
    if not clips:
        raise ArgumentError("pose", f"has {pose!r}, but {document.path} has no animations; omit it")
    names = [clip.get("name") or str(number) for number, clip in enumerate(clips)]
    if name in names:
        return clips[names.index(name)]
    if name.isdecimal() and int(name) < len(clips):
        return clips[int(name)]
    meant = nearest(name, names)
    hint = f" (did you mean {meant!r}?)" if meant else ""
    expected = ", ".join(map(repr, names))
    raise ArgumentError("pose", f"has {pose!r}, but {name!r} is no animation{hint}; expected one of {expected}")


# Samplers.


def _times(document: GltfDocument, sampler: Json) -> Float64Array:
    """Return the times of a sampler's keys, (k,), k >= 1."""
    times: Float64Array = float_values(document, sampler["input"])[:, 0]
    if not len(times) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise damaged_file(
            document.path, f"accessor {sampler['input']} has times of keys, ascending ones were expected"
        )
    return times


def _value(document: GltfDocument, sampler: Json, path: str, time: float) -> Float64Array:
    """Return the value of a sampler at a time: (3,), a unit quaternion (4,), or (n,) weights of morph targets."""
    times, how = _times(document, sampler), sampler.get("interpolation", "LINEAR")
    output = float_values(document, sampler["output"])
    rows = len(times) * (3 if how == "CUBICSPLINE" else 1)
    if not len(output) or output.size % rows or not np.isfinite(output).all():
        raise damaged_file(
            document.path,
            f"accessor {sampler['output']} has {len(output)} values for {len(times)} keys of an animation",
        )
    values = output.reshape(rows, -1)
    if values.shape[1] != {"weights": values.shape[1], "rotation": 4}.get(path, 3):
        raise damaged_file(document.path, f"accessor {sampler['output']} has {values.shape[1]} numbers for a {path}")
    value = _interpolated(times, values, how, time, is_rotation=path == "rotation")
    return value / (np.linalg.norm(value) or 1.0) if path == "rotation" else value


def _interpolated(
    times: Float64Array, values: Float64Array, how: str, time: float, *, is_rotation: bool
) -> Float64Array:
    """Interpolate between keys; before the first and after the last one its value stays.

    times    (k,) ascending
    values   (k, n), of CUBICSPLINE (3 k, n): for each key the tangent that comes in, the value, that which goes out
    """
    cubic = how == "CUBICSPLINE"
    keys = values[1::3] if cubic else values
    after = int(np.searchsorted(times, time, side="right"))
    if after in (0, len(times)):
        return np.asarray(keys[min(after, len(times) - 1)])
    before, interval = after - 1, times[after] - times[after - 1]
    if how == "STEP":
        return np.asarray(keys[before])
    t = float((time - times[before]) / interval)
    if cubic:
        return np.asarray(
            (2 * t**3 - 3 * t**2 + 1) * keys[before]
            + (t**3 - 2 * t**2 + t) * interval * values[3 * before + 2]
            + (3 * t**2 - 2 * t**3) * keys[after]
            + (t**3 - t**2) * interval * values[3 * after]
        )
    if is_rotation:
        return _slerp(keys[before], keys[after], t)
    return np.asarray((1 - t) * keys[before] + t * keys[after])


def _slerp(start: Float64Array, end: Float64Array, t: float) -> Float64Array:
    """Interpolate between two quaternions along the shorter arc."""
    start, end = (quaternion / (np.linalg.norm(quaternion) or 1.0) for quaternion in (start, end))
    cosine: Any = start @ end
    if cosine < 0:
        end, cosine = -end, -cosine
    if cosine > _PARALLEL:
        return np.asarray((1 - t) * start + t * end)
    angle = np.arccos(cosine)
    return np.asarray((np.sin((1 - t) * angle) * start + np.sin(t * angle) * end) / np.sin(angle))
