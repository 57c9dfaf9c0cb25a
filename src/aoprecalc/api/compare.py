"""Compare two results: whether they are equal, near enough, or different."""

from collections.abc import Callable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aoprecalc.api.mesh import given_or_default
from aoprecalc.api.reports import Document
from aoprecalc.errors import ArgumentError, InputError, UsageError
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
from aoprecalc.io.sphere_files.files import READABLE_SPHERE_EXTENSIONS, read_levels
from aoprecalc.metrics import (
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
    """Return the kind of a file, by its extension; of a .json by its contents. Unknown extensions are textures.

    Raises InputError for a .json that cannot be read, or holds neither a sphere set nor a report.
    """
    suffix = path.suffix.lower()
    if suffix in MESH_EXTENSIONS:
        return "mesh"
    if suffix != ".json":
        return "spheres" if suffix in READABLE_SPHERE_EXTENSIONS else "texture"
    document = read_json_object(path)
    if isinstance(document.get("spheres"), list):
        return "spheres"
    if "schema" not in document:
        raise InputError(f'{path}: has neither "spheres" nor a "schema"; a sphere set or a report was expected')
    return "report"


@dataclass(frozen=True)
class CompareReport(Document):
    """How far two results are apart.

    Attributes
    ----------
    kind : {"texture", "mesh", "spheres", "report"}
    a, b : str
        Paths of the two files.
    answer : {"equal", "near", "different"}
        Near: the difference is at most `tolerance`.
    difference : float or None
        In the unit of `kind`, see `CompareOptions`; None where no number can tell.
    tolerance : float
    reason : str
        Why no number can tell; empty where one can.
    details : dict
        What else was measured, by the kind.
    warnings : tuple of str
    """

    schema: int = field(default=SCHEMAS["compare"], kw_only=True)
    kind: Kind
    a: str
    b: str
    answer: Literal["equal", "near", "different"]
    difference: float | None
    tolerance: float
    reason: str
    details: dict[str, Any]
    warnings: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Tell whether the results are equal or near."""
        return self.answer != "different"


@dataclass(frozen=True, eq=False)
class _Input:
    """One of the two results: its contents, the files that they were read from, and warnings."""

    value: Any
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()


def compare(
    a: str | PathLike[str],
    b: str | PathLike[str],
    options: CompareOptions | None = None,
    *,
    picture: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> CompareReport:
    """Compare two files of one kind: textures, meshes with their textures, sphere sets, or reports.

    Parameters
    ----------
    a, b : str or path-like
        The file that is the reference, and the one that is compared with it.
    options : CompareOptions, optional
        The greatest difference that passes.
    picture : str or path-like, optional
        A picture file (or a folder) that shows both textures, B - A, and FLIP, the difference that an eye sees.
    report : str or path-like, optional
        A JSON file (or a folder) for the report.
    progress : Progress, optional
        Receives stages and warnings.

    Returns
    -------
    CompareReport
        A difference beyond `CompareOptions.tolerance` is an answer (`passed` is False); the files are written.

    Raises
    ------
    InputError
        If a file cannot be used.
    UsageError
        If the files are of different kinds, or `picture` is given for a kind that has none.
    OutputError
        If a file cannot be written; then none is.

    References
    ----------
    P. Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020.
    """
    for argument, value in (("a", a), ("b", b)):
        if not isinstance(value, str | PathLike):
            raise ArgumentError(argument, f"is of type {type(value).__name__}, the path of a file was expected")
    options, progress = given_or_default(options, CompareOptions), progress or Progress()
    a, b = Path(a), Path(b)
    wanted = {"picture": (picture, f"{a.stem}_compare.png"), "report": (report, f"{a.stem}_compare.json")}
    paths = {
        name: output_path(output, default, name) for name, (output, default) in wanted.items() if output is not None
    }
    if "picture" in paths:
        choose_bit_depth(paths["picture"], "8")
    with Outputs() as outputs:
        kind = _common_kind(a, b)
        if "picture" in paths and kind not in ("texture", "mesh"):
            raise UsageError(f"{a}: is a {_NAMES[kind]}, which --picture cannot show; omit it")
        read, measure = _METHODS[kind]
        with progress.stage("load"):
            first, second = read(a), read(b)
        outputs.protect([*first.files, *second.files])
        for name, path in paths.items():
            claim_output(outputs, wanted[name][0], path)
        with progress.stage("compare"):
            difference = measure(first.value, second.value)
            answer = difference.answer(options.tolerance)
        if "picture" in paths:
            if difference.pair is None:
                raise UsageError(f"{a}, {b}: have no textures for --picture to show; omit it")
            write_colors(outputs.path(paths["picture"]), comparison_picture(difference.pair))
        lines = [f"{path}: {line}" for path, side in ((a, first), (b, second)) for line in side.warnings]
        document = CompareReport(
            kind=kind,
            a=str(a),
            b=str(b),
            answer=answer,
            difference=difference.value,
            tolerance=options.tolerance,
            reason=difference.reason,
            details=difference.details,
            warnings=(*dict.fromkeys(lines), *difference.warnings),
        )
        if "report" in paths:
            write_json(outputs.path(paths["report"]), document.to_dict())
    for line in document.warnings:
        progress.warn(line)
    return document


def _common_kind(a: Path, b: Path) -> Kind:
    kinds = kind_of(a), kind_of(b)
    if kinds[0] != kinds[1]:
        one, other = (_NAMES[kind] for kind in kinds)
        raise UsageError(f"{a} is a {one} and {b} a {other}; compare two files of one kind")
    return kinds[0]


def _read_texture(path: Path) -> _Input:
    pixels = read_pixels(path)
    if not np.isfinite(pixels).all():
        raise InputError(f"{path}: holds values that are not finite, 0 to 1 were expected; bake it again")
    return _Input(pixels, (path,))


def _read_mesh(path: Path) -> _Input:
    scene = load_scene(path)
    try:
        picture = find_occlusion(scene)
    except NoOcclusionError:
        surface = ComparedMesh(scene.corners, scene.normals, scene.uv_sets)
        return _Input(surface, tuple(source_files(scene)), scene.warnings)
    uvs = np.where(picture.shown[:, None, None], picture.uvs, np.nan)
    surface = ComparedMesh(scene.corners, scene.normals, scene.uv_sets, picture.values[:, :, None], uvs)
    files = [*source_files(scene), *([] if picture.path is None else [picture.path])]
    return _Input(surface, tuple(files), (*scene.warnings, *picture.warnings))


def _read_spheres(path: Path) -> _Input:
    return _Input(read_levels(path), (path,))


def _read_report(path: Path) -> _Input:
    return _Input(read_json_object(path), (path,))


_NAMES: dict[Kind, str] = {"texture": "texture", "mesh": "mesh", "spheres": "sphere set", "report": "report"}

_METHODS: dict[Kind, tuple[Callable[[Path], _Input], Callable[[Any, Any], Difference]]] = {
    "texture": (_read_texture, picture_difference),
    "mesh": (_read_mesh, mesh_difference),
    "spheres": (_read_spheres, spheres_difference),
    "report": (_read_report, document_difference),
}
