"""High to low: the ambient occlusion of a detailed mesh on the texture of a simple one, and what a bake tells of it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike

import numpy as np

from aoprecalc.api.documents import Report
from aoprecalc.api.mesh import Mesh, MeshLike, as_mesh
from aoprecalc.api.surroundings import differences
from aoprecalc.errors import ArgumentError, counted, listed, one_or_many
from aoprecalc.io import load_scene
from aoprecalc.mesh.detail import (
    Cage,
    Detail,
    Matches,
    cage_at,
    detail_of,
    detailed_surface,
    match_parts,
)
from aoprecalc.mesh.surface import absolute_length, bounding_box, box_distance, diagonal, positions_of
from aoprecalc.metrics.difference import rounded
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.options.fields import named_files
from aoprecalc.progress import Note, notes_of, warnings_of
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.types import BoolArray, Scene, Texels
from aoprecalc.visibility.cage import auto_cage, read_cage
from aoprecalc.visibility.gather import TexelOcclusion
from aoprecalc.visibility.rays import require_embreex
from aoprecalc.visibility.setup import BakeSetup

_MANY_MISSES = 0.01  # of the texels: a warning where more are not on the detailed surface
_MIN_SHARE = 0.01  # of its texels: a part of which fewer are not there is not named
_OTHER_SCALE = 8.0  # of one diagonal over another, from which units differ: feet and inches differ by 12
_OTHER_PLACE = 0.1  # of the diagonal of the mesh, by which it reaches beyond details that are elsewhere
_EVERYTHING = "every part meets all of the detailed surface"


@dataclass(frozen=True)
class PartMatch(Report):
    """A part of the mesh, and the parts of the detailed mesh that it meets; empty where it meets all of them."""

    part: str
    high: tuple[str, ...]


@dataclass(frozen=True)
class HighToLow(Report):
    """The detailed surface that was measured.

    triangles      of the detailed mesh
    matches        by part of the mesh that is baked
    cage           least and greatest distance of the cage from the mesh, in its units
    missed         texels whose rays met nothing; missed_share: their share of the texels that the mesh covers
    """

    triangles: int
    matches: tuple[PartMatch, ...]
    cage: tuple[float, float]
    missed: int
    missed_share: float


def detailed_meshes(high: Sequence[MeshLike], options: ValueOptions | VerifyOptions) -> tuple[Scene, ...]:
    """Return detailed meshes that are given beside the options; raises ArgumentError where the options name some."""
    if high and options.high:
        raise ArgumentError("high", "is given twice, in the options and beside them; omit one")
    if isinstance(high, str | PathLike | Mesh):
        high = [high]
    return tuple(as_mesh(mesh)._scene for mesh in high)


def names_of(scenes: Sequence[Scene]) -> tuple[str, ...]:
    """Return what stands for detailed meshes in the options: their paths; of those in memory, their names."""
    return tuple(str(scene.path) for scene in scenes)


def with_detail(low: Scene, options: ValueOptions, threads: int, high: Sequence[Scene] = ()) -> Scene:
    """Return a scene with the surface of detailed meshes to measure in the place of its own, and with messages on them.

    low     with the roles of its parts and its surroundings; see `assign_roles`
    high    the detailed meshes; none: those of the files that `options` name. With neither the scene is returned as is

    Raises RendererError where embreex is missing, InputError where a file cannot be used or the cage is not of this
    mesh, and where normals are asked for that a mesh lacks; UsageError for an unknown extension, and for a cage or
    names of parts without details, and for details together with texels that instances share.
    """
    if not (high or options.high):
        refuse_unused_cage(options)
        return low
    if options.instances == "share":
        raise ArgumentError("instances", "is 'share', but each texel gets one point of {high}; omit one", "high")
    require_embreex()
    scenes = high or [load_scene(path) for path in options.high]
    surface, normals = detailed_surface(scenes, low, options)
    matches = match_parts(low.parts, surface.parts, by_name=options.match == "name")
    detail = Detail(surface, normals, matches.partners, cage_at(low, 0.0))
    detail = replace(detail, cage=_chosen_cage(low, detail, options, threads))
    messages = [
        *(line for scene in scenes for line in differences(low, scene)),
        *_on_place(low, surface),
        *_on_matches(low, surface, matches),
    ]
    read = [
        Note(f"{', '.join(scene.path.name for scene in scenes)}: {counted(len(surface.faces), 'triangle')} of details")
    ]
    return replace(
        low,
        detail=detail,
        warnings=(*low.warnings, *(line for scene in scenes for line in scene.warnings), *warnings_of(messages)),
        notes=(*low.notes, *(line for scene in scenes for line in scene.notes), *read, *notes_of(messages)),
    )


def refuse_unused_cage(options: ValueOptions) -> None:
    """Raise ArgumentError where options say how rays meet a detailed mesh, but name none."""
    for argument in ("cage", "match"):
        if not options.high and (value := getattr(options, argument)) != getattr(ValueOptions, argument):
            raise ArgumentError(argument, f"is {value!r}, but there is no detailed mesh; add {{high}}", "high")


def _chosen_cage(low: Scene, detail: Detail, options: ValueOptions, threads: int) -> Cage:
    if files := named_files(options).get("cage"):
        return read_cage(low, load_scene(files[0]))
    if options.cage == "auto":
        return auto_cage(low, detail, threads)
    if isinstance(options.cage, str):
        return cage_at(low, absolute_length(options.cage, low))
    return cage_at(low, options.cage)


def _on_place(low: Scene, high: Scene) -> list[str]:
    """Return a warning where the mesh reaches beyond the details, as one that is moved, turned or scaled does."""
    box, other = bounding_box(positions_of(low, low.receives)), bounding_box(high.positions)
    beyond = np.maximum(other[0] - box[0], box[1] - other[1])
    axis, size = int(np.argmax(beyond)), diagonal(box)
    if not beyond[axis] > _OTHER_PLACE * size:
        return []
    own, its = (" to ".join(f"{end:.4g}" for end in ends[:, axis]) for ends in (box, other))
    found = f"the mesh reaches {beyond[axis] / size:.0%} of its diagonal beyond the details along {'xyz'[axis]}"
    return [f"{found}: from {own}, the details from {its}; put both in the same place"]


def _on_matches(low: Scene, high: Scene, matches: Matches) -> list[str]:
    """Return notes and warnings about the names of parts."""
    if not matches.wanted or len(low.parts) == len(high.parts) == 1:
        return []
    if not matches.by_name:
        return [Note(f"no names of parts match, such as wheel_low and wheel_high: {_EVERYTHING}")]
    lines = list[str]()
    if matches.low:
        have = one_or_many(len(matches.low), "has no partner and meets", "have no partner and meet")
        lines.append(f"{_named(matches.low)} {have} all of the detailed surface; name them alike, or --match nothing")
    if matches.high:
        found = one_or_many(len(matches.high), "matches no part and only occludes", "match no part and only occlude")
        lines.append(f"{_named(matches.high)} of the detailed mesh {found}; name them alike, or --match nothing")
    return lines


def _named(parts: Sequence[str]) -> str:
    return f"{counted(len(parts), 'part')} ({listed(list(map(repr, parts)))})"


def missed_texels(setup: BakeSetup, sides: Sequence[TexelOcclusion]) -> Texels:
    """Return the covered texels that no side has measured: as a rule, those that are not on the detailed surface.

    None of them without such a surface.
    """
    texels = setup.texels
    if detail_of(setup.inputs.scene) is None:
        return texels.select(slice(0, 0))
    measured: BoolArray = np.zeros(texels.width * texels.height, bool)
    for side in sides:
        measured[side.texels.index[side.measured]] = True
    return texels.select(~measured[texels.index])


def messages_on_misses(setup: BakeSetup, missed: Texels) -> list[str]:
    """Return a note on texels that are not on the detailed surface, a warning where they are many, with the parts."""
    if not len(missed):
        return []
    scene, atlas = setup.inputs.scene, setup.inputs.atlas
    share = len(missed) / len(setup.texels)
    found = f"{share:.1%} of the texels are not on the detailed surface, and filled from those around them"
    if share <= _MANY_MISSES:
        return [Note(found if share >= 0.0005 else found.replace(f"{share:.1%}", counted(len(missed), "texel"), 1))]
    faces = setup.center_samples(missed).faces
    counts = np.bincount(faces[faces >= 0], minlength=len(scene.faces))
    areas = doubled_uv_areas(atlas.uvs) / 2 * atlas.mapped * missed.width * missed.height
    shares = [counts[part.faces].sum() / max(float(areas[part.faces].sum()), 1.0) for part in scene.parts]
    order = [int(number) for number in np.argsort(-np.array(shares), kind="stable") if shares[number] > _MIN_SHARE]
    named = listed([f"{scene.parts[number].name!r}: {min(shares[number], 1.0):.0%}" for number in order])
    parts = f" ({named})" if len(scene.parts) > 1 and named else ""
    advice = "use a greater --cage, or --match nothing where names keep them apart"
    return [f"{found}{parts}; {advice}"]


def nothing_met(scene: Scene, detail: Detail, texels: int) -> str:
    """Say that none of the texels of a mesh meets its detailed surface, why where that is plain, and what to do."""
    low, high = (bounding_box(own.positions) for own in (scene, detail.scene))
    sizes = [diagonal(box) for box in (low, high)]
    found = f"{scene.path}: none of {counted(texels, 'texel')} meets the detailed surface"
    if max(sizes) > _OTHER_SCALE * min(sizes):
        size, other = (f"{length:.3g}" for length in sizes)
        return f"{found}: the diagonal of the mesh is {size}, that of the details {other}; give them the same units"
    if (gap := box_distance(low, high)) > max(sizes):
        return f"{found}, which is {gap:.3g} away from the mesh; put both in the same place"
    return f"{found}; use a greater --cage, or --match nothing where names keep parts apart"


def messages_on_missed_points(errors: TextureErrors) -> list[Note]:
    """Return a note where some of the points of `verify` are not on the detailed surface."""
    missed = int(np.count_nonzero(~errors.hit))
    if not missed:
        return []
    are = one_or_many(missed, "is not on the detailed surface and does", "are not on the detailed surface and do")
    return [Note(f"{missed} of {counted(len(errors.hit), 'point')} {are} not count")]


def high_to_low(scene: Scene, missed: int, covered: int) -> HighToLow | None:
    """Return what a bake reports of a detailed surface; None without one.

    missed    texels without a point on it, of the `covered` ones
    """
    detail = detail_of(scene)
    if detail is None:
        return None
    everything = len(detail.scene.parts)
    distances = detail.cage.distances[scene.receives]
    return HighToLow(
        triangles=len(detail.scene.faces),
        matches=tuple(
            PartMatch(part.name, tuple(detail.scene.parts[index].name for index in of_one if len(of_one) < everything))
            for part, of_one in zip(scene.parts, detail.partners, strict=True)
            if part.receives
        ),
        cage=(rounded(float(distances.min())), rounded(float(distances.max()))),
        missed=missed,
        missed_share=round(missed / covered, 6),
    )
