"""Previews: from a mesh, its texture and spheres to pictures in memory, and from files to a file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isqrt
from os import PathLike
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from aoprecalc.api.documents import Document, Report
from aoprecalc.api.mesh import Mesh, MeshLike, as_mesh, given_or_default
from aoprecalc.api.prepared_scene import standing
from aoprecalc.api.textured_surface import MeshToDraw, mesh_to_draw
from aoprecalc.errors import ArgumentError, UsageError, listed_counts
from aoprecalc.io import MESH_EXTENSIONS, Outputs, checked_spheres
from aoprecalc.io.images import check_picture_extension, picture_png, write_animation, write_picture
from aoprecalc.io.outputs import SCHEMAS, claim_output, output_path
from aoprecalc.io.sphere_files import SPHERE_EXTENSIONS, read_levels
from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import PreviewOptions, Shading, ValueOptions, names_extensions
from aoprecalc.progress import Note, Progress, StageTimer, notes_of, tell, warnings_of
from aoprecalc.render.preview import Spheres, preview_pictures
from aoprecalc.types import Baked, Float64Array, Picture

Output = str | PathLike[str]


class HasSpheres(Protocol):
    """What has spheres, such as SphereSet and SphereResult."""

    @property
    def centers(self) -> Float64Array:
        """Centres in the mesh's coordinates, (n, 3) float64."""

    @property
    def radii(self) -> Float64Array:
        """Radii in the mesh's units, (n,) float64."""


SpheresLike = HasSpheres | str | PathLike[str] | tuple[ArrayLike, ArrayLike]

_TURN = 4.0  # seconds that a turntable takes


@dataclass(frozen=True)
class PreviewedMesh(Report):
    """The mesh that is shown."""

    path: str
    triangles: int


@dataclass(frozen=True)
class PreviewReport(Document):
    """What a preview shows, and its files.

    Attributes
    ----------
    input : PreviewedMesh
    texture : str or None
        The ambient-occlusion texture; None where the mesh has none.
    spheres : int or None
        Number of spheres that are shown; None without any.
    shading : {"ao", "clay", "material"}
        As it was drawn: clay without a texture.
    width, height : int
        Of a picture, in pixels; of the whole sheet where there are several views.
    pictures : int
        Number of views, or of a turntable's frames.
    outputs : tuple of str
        Paths of the files that were written, if any.
    seconds : dict of str to float
        Per stage, and ``"total"``.
    warnings : tuple of str
        What may need an action.
    notes : tuple of str
        Other lines about the result.
    """

    schema: int = field(default=SCHEMAS["preview"], kw_only=True)
    input: PreviewedMesh
    texture: str | None
    spheres: int | None
    shading: Shading
    width: int
    height: int
    pictures: int
    outputs: tuple[str, ...]
    seconds: dict[str, float]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PreviewResult:
    """Pictures of a mesh.

    Attributes
    ----------
    pictures : tuple of ndarray, (height, width, 3) uint8
        sRGB, row 0 on top: one, or one for each view, or for each frame of a turntable.
    image : ndarray, (height, width, 3) uint8
        The picture: the contact sheet of several views, the first frame of a turntable.
    report : PreviewReport
        What is shown.
    """

    pictures: tuple[Picture, ...] = field(repr=False)
    image: Picture = field(repr=False)
    report: PreviewReport
    _name: str = field(repr=False)
    _options: PreviewOptions = field(repr=False)
    _files: tuple[Path, ...] = field(repr=False)

    @names_extensions
    def save(self, output: Output | None = None) -> tuple[Path, ...]:
        """Write the picture, as the command line does.

        Parameters
        ----------
        output : str or path-like, optional
            A file ({pictures}), or a folder, which exists or whose name ends in a slash; by default
            ``<name>_preview.png`` in the current folder. Of a turntable a .webp, or a folder of frames, ``0000.png``
            and so on; by default ``<name>_turntable.webp``.

        Returns
        -------
        tuple of Path
            The files; they appear together, or none does.

        Raises
        ------
        UsageError
            If the extension is unknown, or a file of the input would be replaced.
        OutputError
            If a file cannot be written.
        """
        plan = _Plan.of(output, self._name, self._options)
        with Outputs() as outputs:
            outputs.protect(self._files)
            plan.claim(outputs)
            plan.write(outputs, self)
        return plan.files

    def _repr_png_(self) -> bytes:
        """Show the picture in a notebook."""
        return picture_png(self.image)


def preview(
    mesh: MeshLike,
    options: PreviewOptions | None = None,
    *,
    texture: str | PathLike[str] | ArrayLike | None = None,
    spheres: SpheresLike | None = None,
    progress: Progress | None = None,
) -> PreviewResult:
    """Draw a mesh with its ambient-occlusion texture, and spheres that stand in for it.

    The same input gives the same picture.

    Parameters
    ----------
    mesh : Mesh, str, path-like or trimesh.Trimesh
        A mesh, or the path of a mesh file or of the texture that a bake wrote beside one. Without a texture it is drawn
        as clay.
    options : PreviewOptions, optional
        Size, shading, camera and so on.
    texture : str, path-like or array_like, optional
        The path of a picture, or an array (H, W) with row 0 at v = 1, for any mesh with UVs. By default the mesh's own.
    spheres : SphereSet, SphereResult, str, path-like or (centers, radii), optional
        Spheres, of any origin; of a file with several levels the finest.
    progress : Progress, optional
        Receives stages, notes and warnings.

    Returns
    -------
    PreviewResult
        The pictures.

    Raises
    ------
    ArgumentError
        If `mesh` is not a mesh, `texture` not a texture, or `spheres` are not spheres.
    InputError
        If the mesh, the texture or the sphere file cannot be used.
    RendererError
        If there is no way to render, see `doctor`.

    Examples
    --------
    >>> import aoprecalc as ao
    >>> picture = ao.preview("build/car_ao.glb", ao.PreviewOptions(shading="material"))  # doctest: +SKIP
    >>> picture.save("car.png")  # doctest: +SKIP
    """
    return _preview(mesh, options, texture, spheres, StageTimer(progress or Progress()))


def _preview(
    mesh: MeshLike,
    options: PreviewOptions | None,
    texture: str | PathLike[str] | ArrayLike | None,
    spheres: SpheresLike | None,
    timer: StageTimer,
) -> PreviewResult:
    options = given_or_default(options, PreviewOptions)
    shown, notes = _read_spheres(spheres, options)
    with timer.stage("load"):
        if options.pose is not None:
            given = as_mesh(mesh)
            scene = standing(given._scene, options.pose, ValueOptions())
            mesh = Mesh._of(scene, scene.positions, scene.faces, given.name, given.ao, given._options)
        found = mesh_to_draw(mesh, texture, colors=options.shading == "material")
    result = _draw(replace(found, messages=(*found.messages, *notes)), options, shown, timer)
    tell(timer, (*map(Note, result.report.notes), *result.report.warnings))
    return result


def preview_of_bake(baked: Baked, strength: float, options: PreviewOptions | None) -> Picture:
    """Return the picture of a bake, (height, width, 3) uint8, as a glTF with this strength of occlusion shows it."""
    options = given_or_default(options, PreviewOptions)
    if options.pose is not None:
        scene = standing(baked.scene, options.pose, baked.options)
        baked = replace(baked, scene=scene, normals=shading_normals(scene, "file"))
    found = mesh_to_draw(baked, colors=options.shading == "material")
    if strength != 1:
        strengths = np.full(len(found.mesh.scene.faces), strength, np.float32)
        found = replace(found, mesh=replace(found.mesh, strengths=strengths))
    return _draw(found, options, None, StageTimer(Progress())).image


def notebook_png(draw: Callable[[], Picture]) -> bytes | None:
    """Return what a function draws as PNG; None where it fails, for a notebook then shows the plain text."""
    try:
        return picture_png(draw())
    except Exception:  # whatever it is, the result itself is there
        return None


def _draw(found: MeshToDraw, options: PreviewOptions, spheres: Spheres | None, timer: StageTimer) -> PreviewResult:
    """Draw what was found of a mesh; raises RendererError where there is no way to render."""
    shading, notes = _possible_shading(found, options)
    drawn = replace(options, up=found.up if options.up == "auto" else options.up, shading=shading)
    pictures = tuple(preview_pictures(found.mesh, spheres, drawn, timer))
    image = pictures[0] if options.turntable or len(pictures) == 1 else _sheet(pictures, options)
    messages = (*found.messages, *notes)
    height, width = image.shape[:2]
    scene = found.mesh.scene
    report = PreviewReport(
        input=PreviewedMesh(str(scene.path), len(scene.faces)),
        texture=found.texture,
        spheres=None if spheres is None else len(spheres[1]),
        shading=shading,
        width=width,
        height=height,
        pictures=len(pictures),
        outputs=(),
        seconds=timer.seconds(),
        warnings=warnings_of(messages),
        notes=notes_of(messages),
    )
    return PreviewResult(pictures, image, report, found.name, options, found.files)


def _possible_shading(found: MeshToDraw, options: PreviewOptions) -> tuple[Shading, tuple[Note, ...]]:
    """Return the shading that the mesh allows, and a note where it is another than that asked for."""
    has_texture = found.mesh.ao is not None
    if options.shading == "material" and not found.mesh.base_colors:
        shading: Shading = "ao" if has_texture else "clay"
        return shading, (Note(f"{found.mesh.scene.path}: has no base colours, it is drawn as clay"),)
    return ("clay" if options.shading == "ao" and not has_texture else options.shading), ()


def _sheet(pictures: Sequence[Picture], options: PreviewOptions) -> Picture:
    """Return a contact sheet of views."""
    from aoprecalc.render.comparison import contact_sheet

    turns = [(options.azimuth + 360 * number / len(pictures)) % 360 for number in range(len(pictures))]
    return contact_sheet(
        [(picture, f"{turn:.4g} degrees") for picture, turn in zip(pictures, turns, strict=True)],
        sheet_columns(len(pictures)),
    )


def sheet_columns(count: int) -> int:
    """Return the columns of a sheet of equal pictures: with few gaps, and at most twice as many as rows."""
    least = isqrt(count - 1) + 1

    def gaps(columns: int) -> int:
        return -count % columns

    return min((n for n in range(least, count + 1) if n <= 2 * -(-count // n)), key=gaps, default=least)


# Spheres.


def _read_spheres(given: SpheresLike | None, options: PreviewOptions) -> tuple[Spheres | None, tuple[str, ...]]:
    """Return the spheres to show, the finest level of a file, and a note on that."""
    if given is None:
        if options.spheres_view != PreviewOptions.spheres_view:
            raise ArgumentError(
                "spheres_view", f"is {options.spheres_view}, but there are no {{spheres}}; give some", "spheres"
            )
        return None, ()
    if isinstance(given, str | PathLike):
        levels = read_levels(Path(given))
        counts = listed_counts([len(radii) for _, radii in levels])
        return levels[-1], (Note(f"{given}: has levels of {counts} spheres; the finest is shown"),) * (len(levels) > 1)
    if isinstance(given, tuple) and len(given) == 2:
        return checked_spheres(*given), ()
    if hasattr(given, "centers") and hasattr(given, "radii"):
        return checked_spheres(given.centers, given.radii), ()
    expected = "a SphereSet, a path or a pair of centers and radii was expected"
    raise ArgumentError("spheres", f"is of type {type(given).__name__}, {expected}")


# Files.


@dataclass(frozen=True)
class _Plan:
    """Where a preview goes.

    given    what the user gave
    files    the picture, the animation, or each frame
    frames   the folder of a turntable's frames; None without one
    """

    given: Output | None
    files: tuple[Path, ...]
    frames: Path | None = None

    @classmethod
    def of(cls, output: Output | None, stem: str, options: PreviewOptions) -> "_Plan":
        """Decide on the files; raises UsageError where the extension is of no use."""
        if not options.turntable:
            path = output_path(output, f"{stem}_preview.png")
            check_picture_extension(path)
            return cls(output, (path,))
        path = output_path(output, f"{stem}_turntable.webp")
        if output is not None and path != Path(output):  # a folder was given
            frames = tuple(path.parent / f"{number:04}.png" for number in range(options.frames))
            return cls(output, frames, path.parent)
        if path.suffix.lower() != ".webp":
            raise UsageError(
                f"{path}: a turntable is an animated .webp, or a folder of frames, whose name ends in a slash; "
                "choose one of these"
            )
        return cls(output, (path,))

    def claim(self, outputs: Outputs) -> None:
        """Make sure, before the work, that the files can be written; see Outputs.claim."""
        for file in self.files:
            claim_output(outputs, self.given, file)

    def write(self, outputs: Outputs, result: PreviewResult) -> None:
        """Write the pictures."""
        if self.frames is not None:
            for file, picture in zip(self.files, result.pictures, strict=True):
                write_picture(outputs.path(file), picture)
        elif result._options.turntable:
            write_animation(outputs.path(self.files[0]), result.pictures, _TURN)
        else:
            write_picture(outputs.path(self.files[0]), result.image)


def preview_file(
    mesh: Output,
    output: Output | None = None,
    *,
    texture: Output | None = None,
    spheres: Output | None = None,
    options: PreviewOptions | None = None,
    progress: Progress | None = None,
) -> PreviewReport:
    """Draw a mesh file and write the picture; outputs are checked before the work.

    output   see `PreviewResult.save`
    Raises what `preview` and `PreviewResult.save` raise; then no file is left behind.
    """
    options, timer = options or PreviewOptions(), StageTimer(progress or Progress())
    mesh = Path(mesh)
    if (suffix := mesh.suffix.lower()) in SPHERE_EXTENSIONS and suffix not in MESH_EXTENSIONS:
        raise UsageError(f"{mesh}: is no mesh; name the mesh, and this with --spheres if it has spheres")
    plan = _Plan.of(output, mesh.stem, options)
    with Outputs() as outputs:
        outputs.protect(Path(path) for path in (mesh, texture, spheres) if path is not None)
        plan.claim(outputs)
        result = _preview(mesh, options, texture, spheres, timer)
        outputs.protect(result._files)
        with timer.stage("write"):
            plan.write(outputs, result)
    return replace(result.report, outputs=tuple(map(str, plan.files)), seconds=timer.seconds())
