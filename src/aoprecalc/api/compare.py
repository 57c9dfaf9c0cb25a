"""Compare two results: whether they are equal, near enough, or different."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from aoprecalc.api.documents import Document
from aoprecalc.api.mesh import given_or_default
from aoprecalc.api.textured_surface import TexturedSurface, misfit
from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, UsageError
from aoprecalc.io import (
    MESH_EXTENSIONS,
    Outputs,
    choose_bit_depth,
    find_occlusion,
    load_scene,
    source_files,
    write_colors,
)
from aoprecalc.io.baked_options import baked_options, occlusion_pixels
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.occlusion import NoOcclusionError, mesh_beside
from aoprecalc.io.outputs import SCHEMAS, claim_output, output_path, read_json_object, write_json
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS, read_levels
from aoprecalc.metrics.difference import (
    ComparedMesh,
    ComparedTexture,
    Difference,
    mesh_difference,
    picture_difference,
)
from aoprecalc.metrics.result_difference import document_difference, spheres_difference
from aoprecalc.options import CompareOptions, ValueOptions, VerifyOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.progress import Note, Progress, notes_of, tell, warnings_of
from aoprecalc.render.comparison import comparison_picture

Kind = Literal["texture", "mesh", "spheres", "report"]


def kind_of(path: Path) -> Kind:
    """Return the kind of a file, by its extension; of a .json by its contents. Unknown extensions are textures.

    Raises InputError for a .json that cannot be read, or holds neither a sphere set nor a report.
    """
    suffix = path.suffix.lower()
    if suffix in MESH_EXTENSIONS:
        return "mesh"
    if suffix != ".json":
        return "spheres" if suffix in SPHERE_EXTENSIONS else "texture"
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
        What may need an action.
    notes : tuple of str
        Other lines about the result.
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
    notes: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Tell whether the results are equal or near."""
        return self.answer != "different"


@dataclass(frozen=True, eq=False)
class _Input:
    """One of the two results.

    value      its contents
    files      that they were read from
    warnings   for the user
    options    of the bake of a texture; None where they are not known
    """

    value: Any
    files: tuple[Path, ...]
    warnings: tuple[str, ...] = ()
    options: ValueOptions | None = None


def compare(
    a: str | PathLike[str],
    b: str | PathLike[str],
    options: CompareOptions | None = None,
    *,
    mesh: str | PathLike[str] | None = None,
    picture: str | PathLike[str] | None = None,
    report: str | PathLike[str] | None = None,
    progress: Progress | None = None,
) -> CompareReport:
    """Compare two files of one kind: textures, meshes with their textures, sphere sets, or reports.

    For textures, only texels covered by the surface of A or B count; the report gives the figures of the whole picture
    beside theirs. The surface is that of the mesh (``.obj``, ``.ply``, ``.gltf`` or ``.glb``) beside each texture that
    has its stem. Where only one of them has a mesh, its texels count; where none has, the whole picture does, with
    padding and fill, and a note says so. Where the meshes have different UVs, a warning says so.

    Parameters
    ----------
    a, b : str or path-like
        The file that is the reference, and the one that is compared with it.
    options : CompareOptions, optional
        The greatest difference that passes.
    mesh : str or path-like, optional
        The mesh of both textures, instead of those beside them.
    picture : str or path-like, optional
        A picture file (or a folder) that shows both textures, B - A, and FLIP, the difference that an eye sees.
    report : str or path-like, optional
        A JSON file (or a folder) for the report.
    progress : Progress, optional
        Receives stages, notes and warnings.

    Returns
    -------
    CompareReport
        A difference beyond `CompareOptions.tolerance` is an answer (`passed` is False); the files are written.

    Raises
    ------
    InputError
        If a file cannot be used.
    UsageError
        If the files are of different kinds, or `picture` or `mesh` is given for a kind that has none.
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
        if mesh is not None and kind != "texture":
            raise UsageError(f"{a}: is a {_NAMES[kind]}, --mesh is for textures; omit it")
        with progress.stage("load"):
            first, second = (_read(kind, path, None if mesh is None else Path(mesh)) for path in (a, b))
        outputs.protect([*first.files, *second.files])
        for name, path in paths.items():
            claim_output(outputs, wanted[name][0], path)
        with progress.stage("compare"):
            difference = _MEASURES[kind](first.value, second.value)
            answer = difference.answer(options.tolerance)
        if "picture" in paths:
            if difference.pair is None:
                raise UsageError(f"{a}, {b}: have no textures for --picture to show; omit it")
            write_colors(outputs.path(paths["picture"]), comparison_picture(difference.pair, (f"A: {a}", f"B: {b}")))
        lines = [f"{path}: {line}" for path, side in ((a, first), (b, second)) for line in side.warnings]
        messages: list[str] = [*dict.fromkeys(lines), *difference.warnings]
        for line in baked_differently(first.options, second.options):
            messages.append(line if answer == "different" else Note(line))
        if kind == "texture" and not (difference.reason or difference.details["surface"]):
            told = "no mesh was found beside the textures: the whole picture counts; name their mesh with --mesh"
            messages.append(Note(told))
        document = CompareReport(
            kind=kind,
            a=str(a),
            b=str(b),
            answer=answer,
            difference=difference.value,
            tolerance=options.tolerance,
            reason=difference.reason,
            details=difference.details,
            warnings=warnings_of(messages),
            notes=notes_of(messages),
        )
        if "report" in paths:
            write_json(outputs.path(paths["report"]), document.to_dict())
    tell(progress, messages)
    return document


def baked_differently(a: ValueOptions | None, b: ValueOptions | None) -> list[str]:
    """Return a line on how the options of two bakes differ; none where they are equal or not known."""
    if a is None or b is None or a == b:
        return []
    differing = [field for field in option_fields(ValueOptions) if getattr(a, field.name) != getattr(b, field.name)]
    words = {}
    for name, options in (("A", a), ("B", b)):
        values = [(field, getattr(options, field.name)) for field in differing]
        words[name] = shlex.join(
            word for field, value in values if value != field.default for word in field.words(value)
        )
    first, second = sorted(words, key=lambda name: not words[name])  # one without any comes last
    other = f"with {words[second]}" if words[second] else "without"
    return [f"{first} was baked with {words[first]}, {second} {other}; bake both with the same options"]


def _common_kind(a: Path, b: Path) -> Kind:
    kinds = kind_of(a), kind_of(b)
    if kinds[0] != kinds[1]:
        one, other = (_NAMES[kind] for kind in kinds)
        raise UsageError(f"{a} is a {one} and {b} a {other}; compare two files of one kind")
    return kinds[0]


def _read(kind: Kind, path: Path, mesh: Path | None) -> _Input:
    """Read one of the results; `mesh` is that of a texture, None: the one beside it."""
    if kind == "texture":
        return _read_texture(path, mesh)
    if kind == "mesh":
        return _read_mesh(path)
    return _Input(read_levels(path) if kind == "spheres" else read_json_object(path), (path,))


def _read_texture(path: Path, mesh: Path | None) -> _Input:
    pixels = occlusion_pixels(ImageSource.of(path))
    if not np.isfinite(pixels).all():
        raise InputError(f"{path}: holds values that are not finite, 0 to 1 were expected; bake it again")
    found = mesh or mesh_beside(path)
    if found is not None:
        try:
            surface = TexturedSurface.of(scene := load_scene(found), find_occlusion(scene, path), VerifyOptions())
        except AoprecalcError as error:
            if mesh is not None:
                raise
            options, damage = baked_options(ImageSource.of(path))
            lines = (*damage, f"the whole picture counts, as the mesh beside it cannot be used: {error}")
            return _Input(ComparedTexture(pixels), (path, found), lines, options)
        value = ComparedTexture(pixels, surface.coverage())
        lines = (*surface.warnings, *surface.note_on_strength, *surface.warning_on_mesh)
        return _Input(value, (path, *source_files(scene)), lines, surface.picture.options)
    options, damage = baked_options(ImageSource.of(path))
    return _Input(ComparedTexture(pixels), (path,), damage, options)


def _read_mesh(path: Path) -> _Input:
    scene = load_scene(path)
    try:
        picture = find_occlusion(scene, misfit=misfit(scene, VerifyOptions()))
    except NoOcclusionError:
        mesh = ComparedMesh(scene.corners, scene.normals, scene.uv_sets)
        return _Input(mesh, tuple(source_files(scene)), scene.warnings)
    uvs = np.where(picture.shown[:, None, None], picture.uvs, np.nan)
    pixels = picture.values[:, :, None]
    try:
        surface = TexturedSurface.of(scene, picture, VerifyOptions())
        texture, warnings = ComparedTexture(pixels, surface.coverage()), (*surface.warnings, *surface.note_on_strength)
    except InputError as error:
        texture, warnings = ComparedTexture(pixels), (*picture.warnings, f"the whole picture counts: {error}")
    mesh = ComparedMesh(scene.corners, scene.normals, scene.uv_sets, texture, uvs)
    files = [*source_files(scene), *([] if picture.path is None else [picture.path])]
    return _Input(mesh, tuple(files), (*scene.warnings, *warnings), picture.options)


_NAMES: dict[Kind, str] = {"texture": "texture", "mesh": "mesh", "spheres": "sphere set", "report": "report"}

_MEASURES: dict[Kind, Callable[[Any, Any], Difference]] = {
    "texture": picture_difference,
    "mesh": mesh_difference,
    "spheres": spheres_difference,
    "report": document_difference,
}
