"""The roles of parts: which receive ambient occlusion, and which occlude."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Literal

from aoprecalc.errors import ArgumentError, InputError, UsageError, counted, nearest
from aoprecalc.options import LightOptions, PreviewOptions
from aoprecalc.types import Part, Scene

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
    parts = [_with_roles(part, options) for part in scene.parts]
    if not any(part.receives for part in parts):
        raise _nothing_to_bake(scene, options)
    return replace(scene, parts=_with_shares(parts, share), ground_normal=_ground_normal(scene, options))


def _with_roles(part: Part, options: LightOptions) -> Part:
    included = not _is_named(part, options.exclude)
    receives = included and not part.material.unlit and not _is_named(part, options.occluders_only)
    return replace(
        part,
        receives=receives and (not options.only or _is_named(part, options.only)),
        occludes=included and (options.glass_occludes or not part.material.transparent),
        two_sided=options.two_sided or part.material.foliage,
    )


def _ground_normal(scene: Scene, options: LightOptions) -> tuple[float, float, float] | None:
    return _AXES[up_axis(scene, options)] if options.ground else None


def up_axis(scene: Scene, options: LightOptions | PreviewOptions) -> Literal["x", "y", "z"]:
    """Return the axis that points up from the ground."""
    if options.up == "auto":
        return "z" if scene.format == "stl" else "y"
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
