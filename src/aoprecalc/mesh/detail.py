"""The detailed surface whose ambient occlusion a simpler mesh gets, and which of its parts belong to which of that.

The simple mesh is called low here and the detailed one high, as artists do.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aoprecalc.mesh.roles import assign_roles, finest_level
from aoprecalc.mesh.surface import normalize, shading_normals, smooth_normals
from aoprecalc.options import ValueOptions
from aoprecalc.types import Float32Array, Float64Array, Part, Scene


@dataclass(frozen=True, eq=False)
class Cage:
    """A surface around the low mesh: a ray begins on it, and goes as far behind the low surface as it begins before it.

    directions   (f, 3, 3) float64: the unit vectors from the corners of the low faces towards the cage
    distances    (f, 3) float64 >= 0: from the corners to the cage, in the units of the mesh

    Between the corners both are interpolated, and the direction is normalized.
    """

    directions: Float64Array
    distances: Float64Array


@dataclass(frozen=True, eq=False)
class Detail:
    """A detailed surface, and how points of the low one are projected onto it.

    scene      all of it, with roles: everything receives
    normals    (g, 3, 3) float32: the shading normals at the corners of its faces
    partners   for each part of the low scene the parts of `scene` that it may meet
    cage       where the rays begin
    """

    scene: Scene
    normals: Float32Array
    partners: tuple[tuple[int, ...], ...]
    cage: Cage


def detail_of(scene: Scene) -> Detail | None:
    """Return the detailed surface of a scene; None where its own surface is measured."""
    assert scene.detail is None or isinstance(scene.detail, Detail)
    return scene.detail


def detailed_surface(scenes: Sequence[Scene], low: Scene, options: ValueOptions) -> tuple[Scene, Float32Array]:
    """Join the meshes of a detailed surface; return it with roles, and its shading normals, (g, 3, 3) float32.

    It stands among the surroundings of the low scene, and on its ground where the height of that is given; else the
    ground is at the lowest point of the detailed surface.
    Names of parts in `options` are those of the low mesh and do not count here. Collision hulls and coarser levels of
    detail are left out. Raises InputError where normals are asked for that a mesh does not have.
    """
    if not options.all_parts:
        scenes = [finest_level(scene)[0] for scene in scenes]
    normals = [shading_normals(scene, options.normals, options.crease_angle) for scene in scenes]
    by_material = replace(options, only=(), exclude=(), occluders_only=(), all_parts=True)
    joined = assign_roles(_joined(scenes), by_material)
    parts = (replace(part, receives=True, uv_owner=None) for part in joined.parts)
    return replace(joined, parts=tuple(parts), around=low.around), np.concatenate(normals)


def _joined(scenes: Sequence[Scene]) -> Scene:
    """Return one scene of several, without what only belongs to a file."""
    corners = np.cumsum([0, *(len(scene.positions) for scene in scenes)])
    starts = np.cumsum([0, *(len(scene.faces) for scene in scenes)]).tolist()
    parts = (
        replace(part, start=part.start + start, stop=part.stop + start, instance_of=None, duplicate_of=None)
        for scene, start in zip(scenes, starts[:-1], strict=True)
        for part in scene.parts
    )
    return Scene(
        path=scenes[0].path,
        format=scenes[0].format,
        positions=np.concatenate([scene.positions for scene in scenes]),
        faces=np.concatenate(
            [scene.faces + first for scene, first in zip(scenes, corners[:-1].astype(np.int32), strict=True)]
        ),
        normals=None,
        uv_sets=(),
        parts=tuple(parts),
    )


def smoothed_normals(low: Scene) -> Float64Array:
    """Return the directions from the low surface towards its cage, (f, 3, 3) float64 unit vectors.

    They are the area-weighted means of the receiving faces around each position, also over hard edges.
    """
    directions: Float64Array = np.zeros((len(low.faces), 3, 3))
    directions[low.receives] = smooth_normals(low.positions, low.faces[low.receives])
    return normalize(directions)


def cage_at(low: Scene, distance: float) -> Cage:
    """Return the cage at one distance, in the units of the mesh, along the smoothed normals."""
    return Cage(smoothed_normals(low), np.full((len(low.faces), 3), distance))


def cage_of(low: Scene, cage: Scene) -> Cage:
    """Return the cage that is given as a mesh of the same faces as the low one."""
    offsets = cage.corners - low.corners
    distances = np.linalg.norm(offsets, axis=2)
    directions = np.where(distances[:, :, None] > 0, normalize(offsets), smoothed_normals(low))
    return Cage(directions, distances)


# Names.

_LOW, _HIGH = ("low", "lo", "lp"), ("high", "hi", "hp")


@dataclass(frozen=True)
class Matches:
    """Which parts of the high mesh belong to which of the low one.

    partners         for each part of the low mesh the parts of the high one that it may meet
    wanted           names were compared; by_name: some match, so that parts meet their partners only
    low, high        names of the parts, of either, that have no partner where names match
    """

    partners: tuple[tuple[int, ...], ...]
    wanted: bool
    by_name: bool
    low: tuple[str, ...] = ()
    high: tuple[str, ...] = ()


def match_parts(low: Sequence[Part], high: Sequence[Part], *, by_name: bool) -> Matches:
    """Match parts by their names: `wheel_low` with `wheel_high`, and with `wheel_high_bolts`.

    The words low, lo, lp and high, hi, hp, in any case, begin or end the name, and what follows them at its end does
    not count; they may be left out. A part whose own name matches none has the names of what it belongs to (its groups,
    the nodes above it, its mesh) that have such a word. A low part without a partner, and all where no names match,
    may meet every part.
    """
    everything = tuple(range(len(high)))
    if not by_name:
        return Matches((everything,) * len(low), wanted=False, by_name=False)
    low_names, high_names = (
        [_Names.of(part, words) for part in parts] for parts, words in ((low, _LOW), (high, _HIGH))
    )
    known = [{name for names in every for name in (names.own, *names.others)} for every in (high_names, low_names)]
    low_keys, high_keys = (
        [names.found_in(other) for names in every] for every, other in zip((low_names, high_names), known, strict=True)
    )
    partners = [tuple(index for index in everything if keys & high_keys[index]) for keys in low_keys]
    if not any(partners):
        return Matches((everything,) * len(low), wanted=True, by_name=False)
    found = {index for of_one in partners for index in of_one}
    return Matches(
        tuple(of_one or everything for of_one in partners),
        wanted=True,
        by_name=True,
        low=tuple(part.name for part, of_one in zip(low, partners, strict=True) if part.receives and not of_one),
        high=tuple(high[index].name for index in everything if index not in found),
    )


@dataclass(frozen=True)
class _Names:
    """The name of a part without the word that says whether it is low or high, and those of what it belongs to."""

    own: str
    others: frozenset[str]

    @classmethod
    def of(cls, part: Part, words: tuple[str, ...]) -> "_Names":
        others = (_without_word(name, words) for name in part.names)
        return cls(_without_word(part.name, words) or part.name.casefold(), frozenset(filter(None, others)))

    def found_in(self, names: set[str]) -> frozenset[str]:
        return frozenset({self.own}) if self.own in names else self.others & names


def _without_word(name: str, words: tuple[str, ...]) -> str:
    """Return a name in lower case without one of the words; empty where it has none."""
    word, between = f"(?:{'|'.join(words)})", r"[_\-. ]"
    folded = name.casefold()
    if found := re.fullmatch(rf"(.+?){between}{word}(?:{between}.*)?", folded):
        return found[1]
    return found[1] if (found := re.fullmatch(rf"{word}{between}(.+)", folded)) else ""
