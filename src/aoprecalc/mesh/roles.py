"""The roles of parts: which receive ambient occlusion, which occlude, at which level of detail, which by themselves."""

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Literal

import numpy as np

from aoprecalc.errors import ArgumentError, InputError, UsageError, counted, nearest
from aoprecalc.mesh.topology import face_components
from aoprecalc.options import LightOptions, PreviewOptions
from aoprecalc.types import BoolArray, Float32Array, Float64Array, Ground, Part, Scene, Surroundings

_CELLS = 64  # along the longest side of the parts that receive: those with an empty one between them are apart
_MAX_SHARE, _MAX_GROUPS = 1 / 32, 16  # of that side that each group of parts takes up at most; groups
_MAX_NAMES = 10  # in an error about a wrong one
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def assign_roles(scene: Scene, options: LightOptions, *, share: bool = False) -> Scene:
    """Return the scene with the ground plane and the roles of its parts, by options and materials.

    share   instances of a mesh share one UV region

    Raises UsageError where no part has a name and where the options leave no part that receives, InputError where all
    parts are unlit.
    """
    for argument in ("only", "exclude", "occluders_only"):
        _require_known(scene.parts, argument, getattr(options, argument))
    if not options.all_parts:
        scene = _with_hulls_and_levels(scene)
    parts = [_with_roles(part, number, options) for number, part in enumerate(scene.parts)]
    if not any(part.receives for part in parts):
        raise _nothing_to_bake(scene, options)
    return replace(
        scene,
        parts=_with_shares(parts, share),
        backs_occlude=options.backfaces == "occlude",
        around=replace(scene.around, ground=_ground(scene, options)),
    )


def without_surroundings(scene: Scene) -> Scene:
    """Return a scene alone: no ground, sky, occluders of other files or detailed surface; backs occlude, too."""
    return replace(scene, around=Surroundings(), backs_occlude=True, detail=None)


def _with_roles(part: Part, number: int, options: LightOptions) -> Part:
    hull = part.hull and not _is_named(part, [*options.only, *options.occluders_only])  # unless the user asks for it
    included = not hull and not _is_named(part, options.exclude)
    receives = included and not part.material.unlit and not _is_named(part, options.occluders_only)
    return replace(
        part,
        receives=receives and (not options.only or _is_named(part, options.only)),
        occludes=included and (options.glass_occludes or not part.material.transparent),
        two_sided=options.two_sided or part.material.foliage,
        self_occluded=None if _is_named(part, options.occluders_only) else _own_group(part, number, options),
    )


def _own_group(part: Part, number: int, options: LightOptions) -> int | None:
    """Return the number of the parts that alone occlude each other, one of which is this part; None for all of them."""
    if options.self_occlusion == "material":
        return part.file_material or 0
    of_file = number if part.file_object is None else part.file_object
    return of_file if options.self_occlusion == "part" else None


def _ground(scene: Scene, options: LightOptions) -> Ground | None:
    return Ground(_AXES[up_axis(scene, options)], options.ground_height) if options.ground else None


def up_axis(scene: Scene, options: LightOptions | PreviewOptions) -> Literal["x", "y", "z"]:
    """Return the axis that points up from the ground."""
    if options.up == "auto":
        return scene.up or ("z" if scene.format == "stl" else "y")
    return options.up


def _with_shares(parts: Sequence[Part], share: bool) -> tuple[Part, ...]:
    """Let instances share the UV region of the first of them that receives."""
    first: dict[int, int] = {}
    result = []
    for number, part in enumerate(parts):
        original = part.instance_of if share else part.duplicate_of
        owner = first.setdefault(number if original is None else original, number) if part.receives else number
        result.append(replace(part, uv_owner=None if owner == number else owner))
    return tuple(result)


def names_a_part(parts: Sequence[Part], pattern: str) -> bool:
    """Tell whether a name, which may contain `*` and `?`, is that of a part."""
    return any(_is_named(part, [pattern]) for part in parts)


def _is_named(part: Part, patterns: Collection[str]) -> bool:
    wanted = [pattern.replace("[", "[[]") for pattern in patterns]  # brackets are literal, not a pattern
    return any(fnmatchcase(name, pattern) for name in {part.name, *part.names} for pattern in wanted)


def _require_known(parts: Sequence[Part], argument: str, patterns: Collection[str]) -> None:
    for pattern in patterns:
        if not names_a_part(parts, pattern):
            names = sorted({name for part in parts for name in (part.name, *part.names)})
            more = f" or {counted(len(names) - _MAX_NAMES, 'other')}" if len(names) > _MAX_NAMES else ""
            expected = ", ".join(map(repr, names[:_MAX_NAMES])) + more
            meant = nearest(pattern, names)
            hint = f" (did you mean {meant!r}?)" if meant else ""
            raise ArgumentError(
                argument, f"has {pattern!r}, which is not the name of a part{hint}; expected one of {expected}"
            )


def _nothing_to_bake(scene: Scene, options: LightOptions) -> InputError | UsageError:
    asked = [part for part in scene.parts if not options.only or _is_named(part, options.only)]
    if all(part.material.unlit for part in asked):
        return InputError(
            f"{scene.path}: nothing to bake: its materials are unlit (KHR_materials_unlit), which no ambient occlusion "
            "shows on; make them lit ones"
        )
    return ArgumentError(
        "only",
        f"or {{exclude}} or {{occluders_only}} leave no part that receives in {scene.path}; name fewer",
        "exclude",
        "occluders_only",
    )


def at_level(scene: Scene, level: int) -> Scene:
    """Return a scene with roles at one of its levels of detail: parts of others neither receive nor occlude.

    A part that several levels show receives in the first of them.
    """
    if scene.levels == 1:
        return scene
    parts = (
        replace(
            part,
            receives=part.receives and level == (part.levels or range(1)).start,
            occludes=part.occludes and (part.levels is None or level in part.levels),
        )
        for part in scene.parts
    )
    return replace(scene, parts=tuple(parts))


def baked_apart(scene: Scene) -> tuple[Scene, ...]:
    """Return the scene with the roles of its parts in each of the passes in which it is baked; one, as a rule.

    Levels of detail are baked by themselves, and so are up to 16 groups of parts that are small and far apart: maps and
    rays that are as fine as one group needs could not reach to the next. All of them occlude in each of these passes.
    """
    levels = [at_level(scene, level) for level in range(scene.levels)]
    groups = [group for shown in levels if shown.receives.any() for group in _groups(shown)]
    return tuple(group for group in groups if group.receives.any())


def in_poses(scene: Scene, normals: Float32Array) -> tuple[tuple[Scene, Float32Array], ...]:
    """Return a scene and its shading normals, (f, 3, 3), in each of its poses; as it stands where it has none.

    The roles of its parts are the same in all of them.
    """
    if not scene.poses:
        return ((scene, normals),)
    posed = list[tuple[Scene, Float32Array]]()
    for pose in scene.poses.values():
        assert pose.normals is not None  # see Scene.poses
        own = replace(scene, positions=pose.positions, faces=pose.faces, normals=pose.normals, poses={})
        posed.append((own, pose.normals))
    return tuple(posed)


def _groups(scene: Scene) -> tuple[Scene, ...]:
    receives = scene.receives
    receiving = [number for number, part in enumerate(scene.parts) if receives[part.faces].any()]
    if len(receiving) < 2 or any(part.uv_owner is not None or part.self_occluded is not None for part in scene.parts):
        return (scene,)
    from scipy.ndimage import label  # in functions: slow to import

    corners = [scene.positions[np.unique(scene.faces[scene.parts[number].faces])] for number in receiving]
    lows, highs = (np.array([getattr(np, end)(points, axis=0) for points in corners]) for end in ("min", "max"))
    origin, side = lows.min(axis=0), (highs.max(axis=0) - lows.min(axis=0)).max()
    if not side > 0:
        return (scene,)
    cells = (np.stack([lows, highs]) - origin) * (_CELLS / side)
    first, last = np.minimum(cells.astype(int), _CELLS - 1)
    taken = np.zeros((_CELLS,) * 3, bool)
    for low, high in zip(first, last + 1, strict=True):
        taken[tuple(map(slice, low, high))] = True
    labels, count = label(taken, np.ones((3, 3, 3)))
    group_of = labels[tuple(first.T)]
    numbers = range(1, count + 1)
    sides = [(highs[group_of == n].max(axis=0) - lows[group_of == n].min(axis=0)).max() for n in numbers]
    if not 1 < count <= _MAX_GROUPS or max(sides) > _MAX_SHARE * side:
        return (scene,)
    group_of_part = dict(zip(receiving, group_of.tolist(), strict=True))
    return tuple(
        replace(
            scene,
            parts=tuple(
                replace(part, receives=part.receives and group_of_part.get(number, 1) == n)
                for number, part in enumerate(scene.parts)
            ),
        )
        for n in numbers
    )


def finest_level(scene: Scene) -> tuple[Scene, BoolArray]:
    """Return a scene without collision hulls and coarser levels of detail, and the faces that it keeps, (f,) bool."""
    scene = _with_hulls_and_levels(scene)
    kept = [not part.hull and (part.levels is None or part.levels.start == 0) for part in scene.parts]
    if all(kept):
        return scene, np.ones(len(scene.faces), bool)
    return with_parts(scene, kept), scene.per_face(kept)


def with_parts(scene: Scene, kept: Sequence[bool]) -> Scene:
    """Return a scene with some of its parts only, at least one."""
    faces = scene.per_face(kept)
    used, corners = np.unique(scene.faces[faces], return_inverse=True)
    number = np.cumsum(kept) - 1  # of each part among those that are kept
    parts, start = list[Part](), 0

    def renumbered(index: int | None) -> int | None:
        return int(number[index]) if index is not None and kept[index] else None

    for part in (part for part, keep in zip(scene.parts, kept, strict=True) if keep):
        stop = start + part.stop - part.start
        moved = replace(part, start=start, stop=stop, levels=None, instance_of=renumbered(part.instance_of))
        parts.append(replace(moved, duplicate_of=renumbered(part.duplicate_of), uv_owner=renumbered(part.uv_owner)))
        start = stop
    return replace(
        scene,
        positions=scene.positions[used],
        faces=corners.reshape(-1, 3).astype(np.int32),
        normals=None if scene.normals is None else scene.normals[faces],
        uv_sets=tuple(uvs[faces] for uvs in scene.uv_sets),
        parts=tuple(parts),
        polygons=None if scene.polygons is None else scene.polygons[faces],
        baked_only=None if scene.baked_only is None else scene.baked_only[faces],
    )


# What the names of parts say in games: collision hulls, and levels of detail.

_HULL = re.compile(r"(?:UCX|UBX|UCP|USP)_.+|.+-(?:convcol|col|occ)only(?:\W?\d+)?", re.IGNORECASE)  # Unreal, Godot
_MAYBE_HULL = re.compile(r"(?:col|collision|collider)[_\-. ](.+)|(.+)[_\-. ](?:col|collision|collider)", re.IGNORECASE)
_COPY = re.compile(r"[_\-. ]?\d+$")  # the number of a copy, at the end of a name
_SAME_BOX = 0.5  # intersection over union of two bounding boxes
_LEVEL = re.compile(r"(?:(?:^|[_\-. ])[Ll][Oo][Dd]|(?<=[a-z0-9])LOD)[_\-. ]?(\d{1,2})(?![0-9A-Za-z])")


def _with_hulls_and_levels(scene: Scene) -> Scene:
    """Mark collision hulls and levels of detail; none of them shares positions with what is not shown with it."""
    hulls = _find_hulls(scene)
    if all(hulls):  # such as a file that holds nothing else
        hulls = [False] * len(hulls)
    levels = _find_levels([None if hull else part for part, hull in zip(scene.parts, hulls, strict=True)])
    if not any(hulls) and not any(levels):
        return scene
    parts = [
        replace(part, hull=hull, levels=shown) for part, hull, shown in zip(scene.parts, hulls, levels, strict=True)
    ]
    positions, faces = [scene.positions], scene.faces.copy()
    apart = [-1 if part.hull else part.levels.start if part.levels else 0 for part in parts]
    for group in sorted(set(apart) - {0}):
        chosen = scene.per_face(other == group for other in apart)
        used, corners = np.unique(faces[chosen], return_inverse=True)
        faces[chosen] = corners.reshape(-1, 3) + sum(map(len, positions))
        positions.append(scene.positions[used])
    used, corners = np.unique(faces, return_inverse=True)
    faces = corners.reshape(-1, 3).astype(np.int32)
    return replace(scene, parts=tuple(parts), positions=np.concatenate(positions)[used], faces=faces)


def _find_hulls(scene: Scene) -> list[bool]:
    """Tell which parts are collision hulls.

    Some names say so (UCX_wall, wall-colonly). Others may (COL_wall, wall_collision), as `Col_1` may be a column: these
    are hulls where the rest of the name is that of another part, or where their bounding box is that of the others.
    """
    names = [{part.name, *part.names} for part in scene.parts]
    certain = [any(_HULL.fullmatch(name) for name in own) for own in names]
    rests = [
        {rest.lower() for name in own if (found := _MAYBE_HULL.fullmatch(name)) for rest in found.groups() if rest}
        for own in names
    ]
    rests = [{form for rest in own for form in (rest, _COPY.sub("", rest))} for own in rests]
    others = [index for index, own in enumerate(rests) if not own and not certain[index]]
    known = {name.lower() for index in others for name in names[index]}
    hulls = []
    for index, own in enumerate(rests):
        same = bool(own) and bool(others) and (bool(own & known) or _same_box(scene, index, others))
        hulls.append(certain[index] or same)
    return hulls


def _same_box(scene: Scene, part: int, others: Sequence[int]) -> bool:
    """Tell whether the bounding box of a part is about that of one of the others, or of all of them."""
    boxes = {index: _box(scene, scene.parts[index]) for index in (part, *others)}
    every = np.array([boxes[index] for index in others])
    of_others = [*every, np.array([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])]
    (low, high), size = boxes[part], float(np.ptp(scene.positions, axis=0).max())
    for low_2, high_2 in of_others:
        # Flat boxes have a thickness here, too.
        shared, both = (
            np.prod(np.maximum(end - start, 0) + 1e-3 * size)
            for start, end in (
                (np.maximum(low, low_2), np.minimum(high, high_2)),
                (np.minimum(low, low_2), np.maximum(high, high_2)),
            )
        )
        if shared > _SAME_BOX * both:
            return True
    return False


def _box(scene: Scene, part: Part) -> Float64Array:
    """Return the least and the greatest coordinates of a part, (2, 3)."""
    corners = scene.positions[scene.faces[part.faces]].reshape(-1, 3)
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def _find_levels(parts: Sequence[Part | None]) -> list[range | None]:
    """Return the levels of detail of the scene that show each part; None for a part that all of them show.

    Where an object has fewer levels than another, its coarsest one stands for those that it lacks.
    """
    found = [None if part is None else _level_of(part) for part in parts]
    objects = {base for base, _ in filter(None, found)}
    for index, part in enumerate(parts):
        if part is not None and found[index] is None and (name := part.name.lower()) in objects:
            found[index] = (name, -1)  # tree, beside tree_LOD1
    levels = {base: sorted({level for other, level in filter(None, found) if other == base}) for base in objects}
    count = max(map(len, levels.values()), default=1)
    result: list[range | None] = []
    for entry in found:
        if entry is None or len(levels[entry[0]]) == 1:
            result.append(None)
            continue
        own = levels[entry[0]]
        level = own.index(entry[1])
        result.append(range(level, count if level == len(own) - 1 else level + 1))
    return result


def _level_of(part: Part) -> tuple[str, int] | None:
    """Return the object of which a part is a level of detail, and the number of the level; None where it is none."""
    if part.lod is not None:
        return f"node {part.lod[0]}", part.lod[1]
    for name in (part.name, *sorted(part.names)):
        if found := _LEVEL.search(name):
            before, after = (text.strip("_-. ").lower() for text in (name[: found.start()], name[found.end() :]))
            return before or after, int(found.group(1))
    return None


# A part that leaves the others little of the texture.

_MIN_TEXTURE_SHARE = 1 / 2  # of the texture
_MAX_FACE_SHARE = 1 / 4  # of the faces
_MAX_RELATIVE_SIZE = 1 / 8  # of its diagonal


def surrounding_part(scene: Scene, areas: Float64Array) -> Part | None:
    """Return the part that takes most of the texture as it is far larger than the others, such as a sky or a plain.

    areas   (f,) of the faces in the texture, in any unit
    It has more than half of their area and less than a quarter of the faces, and the connected pieces of all others are
    on the mean, by area, less than an eighth of its size (diagonals of bounding boxes). So neither a body with many
    small parts nor a room with furniture is meant.
    """
    shares = [float(areas[part.faces].sum()) for part in scene.parts]
    part = scene.parts[int(np.argmax(shares))]
    rest = areas > 0
    faces = int(np.count_nonzero(rest))
    rest[part.faces] = False
    if (
        max(shares) <= _MIN_TEXTURE_SHARE * sum(shares)
        or part.stop - part.start >= _MAX_FACE_SHARE * faces
        or not rest.any()
    ):
        return None
    corners = scene.faces[rest]
    piece = face_components(corners)
    low, high = (np.full((int(piece.max()) + 1, 3), infinity) for infinity in (np.inf, -np.inf))
    np.minimum.at(low, piece, scene.positions[corners].min(axis=1))
    np.maximum.at(high, piece, scene.positions[corners].max(axis=1))
    diagonals = np.linalg.norm(high - low, axis=1)[piece]
    own = np.linalg.norm(np.ptp(scene.positions[scene.faces[part.faces]].reshape(-1, 3), axis=0))
    return part if np.average(diagonals, weights=areas[rest]) < _MAX_RELATIVE_SIZE * own else None
