"""What surrounds a mesh where it will stand, from files that the options name: other meshes, which occlude it."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, counted, option_name
from aoprecalc.io import load_scene
from aoprecalc.mesh.opaque_triangles import opaque_triangles
from aoprecalc.mesh.roles import finest_level
from aoprecalc.options import ValueOptions
from aoprecalc.options.fields import named_files, with_files
from aoprecalc.progress import Note
from aoprecalc.types import Float64Array, Scene


def with_surroundings(scene: Scene, options: ValueOptions) -> Scene:
    """Return the scene with the triangles of the files that occlude it, and with warnings and notes about these files.

    scene     with the roles of its parts; see `assign_roles`
    options   `occluder` names the files, each in the units and axes of the scene. Of a file its finest level of detail
              counts, without collision hulls unless `all_parts`, and without transparent materials unless
              `glass_occludes`; alpha masks have their holes

    Raises InputError where a file is missing, damaged or has no faces, UsageError for an unknown extension.
    """
    if not options.occluder:
        return scene
    triangles, warnings, notes = list[Float64Array](), list[str](), list[str]()
    for path in options.occluder:
        other = load_scene(path)
        found = _occluding_triangles(other, options)
        triangles.append(found)
        warnings += [*other.warnings, *_differences(scene, other)]
        notes += [*other.notes, Note(f"{other.path.name}: occludes with {counted(len(found), 'triangle')}")]
    return replace(
        scene,
        surroundings=np.concatenate(triangles),
        warnings=(*scene.warnings, *warnings),
        notes=(*scene.notes, *notes),
    )


def _occluding_triangles(scene: Scene, options: ValueOptions) -> Float64Array:
    """Return the triangles of a file that occlude, (o, 3, 3)."""
    if not options.all_parts:
        scene = finest_level(scene)[0]
    parts = (
        replace(part, occludes=options.glass_occludes or not part.material.transparent, receives=True)
        for part in scene.parts
    )
    return opaque_triangles(replace(scene, parts=tuple(parts)))


def _differences(scene: Scene, other: Scene) -> Iterator[str]:
    """Yield warnings about units and axes that differ: numbers are taken as they are."""
    for what, own, its in (("up axis", scene.up, other.up), ("unit in metres", scene.unit, other.unit)):
        if own is not None and its is not None and own != its:
            found = f"{other.path.name}: its {what} is {its}, that of {scene.path.name} is {own}"
            yield f"{found}; both are taken as they are written, export them alike"


def files_beside(options: ValueOptions, scene: Scene, texture: str) -> ValueOptions:
    """Return the options of a bake with paths for the names of files, which are all that its texture has.

    options   as a texture says them, or as they were given, with paths
    scene     the mesh, beside which the files are looked for
    texture   its name, for messages

    Raises InputError where a file is neither there nor at the path itself.
    """
    found = with_files(options, lambda name: _beside(name, scene.path.parent))
    for option, paths in named_files(found).items():
        for path in paths:
            if not Path(path).is_file():
                raise InputError(
                    f"{texture}: was baked with {Path(path).name}, which is not in the folder of {scene.path}; "
                    f"give its path with {option_name(option)}"
                )
    return found


def _beside(path: str, folder: Path) -> str:
    beside = folder / path
    return str(beside) if beside.is_file() else path
