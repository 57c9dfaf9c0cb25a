"""What a result is, by the name of its file, and what is in it where several have one extension."""

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aoprecalc import __version__
from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import (
    MESH_EXTENSIONS,
    Outputs,
    choose_bit_depth,
    find_occlusion,
    load_scene,
    source_files,
    write_colors,
)
from aoprecalc.io.images import read_pixels
from aoprecalc.io.meshes import NoOcclusionError
from aoprecalc.io.outputs import SCHEMAS, claim_output, output_path, read_json_object, write_json
from aoprecalc.io.sphere_files.files import read_levels
from aoprecalc.metrics import (
    Answer,
    ComparedMesh,
    Difference,
    document_difference,
    mesh_difference,
    picture_difference,
    spheres_difference,
)
from aoprecalc.options import CompareOptions
from aoprecalc.progress import Progress
from aoprecalc.render import comparison_picture

Kind = Literal["texture", "mesh", "spheres", "report"]


def kind_of(path: Path) -> Kind:
    """Return what a file is to hold: of .json what it does hold, of an extension that no other kind has a texture.

    Raises InputError for a .json that cannot be read, or holds neither a sphere set nor a report.
    """
    suffix = path.suffix.lower()
    if suffix in MESH_EXTENSIONS:
        return "mesh"
    if suffix in (".csv", ".npz"):
        return "spheres"
    if suffix != ".json":
        return "texture"
    document = read_json_object(path)
    if isinstance(document.get("spheres"), list):
        return "spheres"
    if "schema" not in document:
        raise InputError(f'{path}: has neither "spheres" nor a "schema"; a sphere set or a report was expected')
    return "report"


# Compare: whether two results are the same, near enough, or different.


@dataclass(frozen=True, eq=False)
class CompareResult:
    """Whether two results are the same: the answer, what was measured, and the report (see the README for its keys)."""

    answer: Answer
    difference: Difference
    report: dict[str, Any]

    @property
    def passed(self) -> bool:
        """The results are equal or near."""
        return bool(self.answer != "different")


@dataclass(frozen=True, eq=False)
class _Read:
    """What is compared of a file, the files that it was read from, and what the user should know about it."""

    value: Any
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()


def compare(
    a: str | PathLike[str],
    b: str | PathLike[str],
    *,
    picture: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    options: CompareOptions | None = None,
    progress: Progress | None = None,
) -> CompareResult:
    """Compare two files of one kind: textures, meshes with their textures, sphere sets, or reports.

    picture   a picture file for both textures, B - A, and what an eye sees of it
    report    a JSON file for the report
    That they are different is an answer, not an error: the files appear. Raises InputError where a file cannot be used,
    UsageError where they are of different kinds, or OutputError; then no file appears.
    """
    options, progress = options or CompareOptions(), progress or Progress()
    a, b = Path(a), Path(b)
    wanted = {"picture": (picture, f"{a.stem}_compare.png"), "report": (report, f"{a.stem}_compare.json")}
    places = {name: output_path(path, default) for name, (path, default) in wanted.items() if path is not None}
    if "picture" in places:
        choose_bit_depth(places["picture"], "8")
    with Outputs() as outputs:
        kind = _common_kind(a, b)
        if "picture" in places and kind not in ("texture", "mesh"):
            raise UsageError(f"{a}: is a {_NAMES[kind]}, of which --picture shows nothing; omit it")
        read, measure = _WAYS[kind]
        with progress.stage("load"):
            first, second = read(a), read(b)
        outputs.protect([*first.files, *second.files])
        for name, place in places.items():
            claim_output(outputs, wanted[name][0], place)
        with progress.stage("compare"):
            difference = measure(first.value, second.value)
            answer = difference.answer(options.tolerance)
        if "picture" in places:
            if difference.pair is None:
                raise UsageError(f"{a}, {b}: have no textures to be compared, so --picture shows nothing; omit it")
            write_colors(outputs.path(places["picture"]), comparison_picture(difference.pair))
        said = [f"{path}: {line}" for path, found in ((a, first), (b, second)) for line in found.warnings]
        warnings = [*dict.fromkeys(said), *difference.warnings]
        document = {
            "schema": SCHEMAS["compare"],
            "version": __version__,
            "kind": kind,
            "a": str(a),
            "b": str(b),
            "answer": answer,
            "difference": difference.value,
            "tolerance": options.tolerance,
            "reason": difference.reason,
            "details": difference.details,
            "warnings": warnings,
        }
        if "report" in places:
            write_json(outputs.path(places["report"]), document)
    for line in warnings:
        progress.warn(line)
    return CompareResult(answer, difference, document)


def _common_kind(a: Path, b: Path) -> Kind:
    kinds = kind_of(a), kind_of(b)
    if kinds[0] != kinds[1]:
        one, other = (_NAMES[kind] for kind in kinds)
        raise UsageError(f"{a} is a {one} and {b} a {other}; compare two files of one kind")
    return kinds[0]


def _read_texture(path: Path) -> _Read:
    pixels = read_pixels(path)
    if not np.isfinite(pixels).all():
        raise InputError(f"{path}: holds values that are not finite, 0 to 1 were expected; bake it again")
    return _Read(pixels, (path,))


def _read_mesh(path: Path) -> _Read:
    scene = load_scene(path)
    try:
        found = find_occlusion(scene)
    except NoOcclusionError:
        surface = ComparedMesh(scene.corners, scene.normals, scene.uv_sets)
        return _Read(surface, tuple(source_files(scene)), scene.warnings)
    lies = np.where(found.shown[:, None, None], found.uvs, np.nan)
    surface = ComparedMesh(scene.corners, scene.normals, scene.uv_sets, found.values[:, :, None], lies)
    files = [*source_files(scene), *([] if found.path is None else [found.path])]
    return _Read(surface, tuple(files), (*scene.warnings, *found.warnings))


def _read_spheres(path: Path) -> _Read:
    return _Read(read_levels(path), (path,))


def _read_report(path: Path) -> _Read:
    return _Read(read_json_object(path), (path,))


_NAMES: dict[Kind, str] = {"texture": "texture", "mesh": "mesh", "spheres": "sphere set", "report": "report"}

_WAYS: dict[Kind, tuple[Callable[[Path], _Read], Callable[[Any, Any], Difference]]] = {
    "texture": (_read_texture, picture_difference),
    "mesh": (_read_mesh, mesh_difference),
    "spheres": (_read_spheres, spheres_difference),
    "report": (_read_report, document_difference),
}
