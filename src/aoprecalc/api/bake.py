"""Bake ambient occlusion: from a mesh to its texture in memory, and from a mesh file to files."""

from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

from aoprecalc.api.bake_scene import bake_report, bake_scene
from aoprecalc.api.mesh import BakedMesh, MeshLike, as_mesh, given_or_default
from aoprecalc.api.reports import BakeOutputs, BakeReport
from aoprecalc.api.verify import measure_texture, warn_of_shared_uvs
from aoprecalc.io import (
    Outputs,
    check_mesh_extension,
    choose_bit_depth,
    load_scene,
    output_mesh_extension,
    read_image,
    source_files,
    write_baked_mesh,
    write_image,
)
from aoprecalc.io.baked_options import options_text
from aoprecalc.io.formats.base import output_uvs
from aoprecalc.io.outputs import claim_output, output_path, write_json
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.options import BakeOptions, VerifyOptions
from aoprecalc.progress import Note, Progress, StageTimer, notes_of, tell, warnings_of
from aoprecalc.types import Baked, BoolArray, Float32Array, Scene
from aoprecalc.visibility.gather import LocalVisibility, VisibilityFactory
from aoprecalc.visibility.rays import require_embreex

Output = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class BakeFiles:
    """Paths of the files of a bake: the texture and the mesh; others that go with the mesh are beside it."""

    texture: Path
    mesh: Path


@dataclass(frozen=True, eq=False)
class BakeResult:
    """An ambient-occlusion texture and the mesh that it belongs to.

    Attributes
    ----------
    ao : ndarray, (H, W) float32
        Ambient occlusion in [0, 1], 1 is open; row 0 is v = 1. Padded and filled, see `BakeOptions`.
    valid : ndarray, (H, W) bool
        Texels that the surface covers and whose value was measured.
    mesh : BakedMesh
        The `Mesh` with the UVs (F, 3, 2) of the texture and the normals (F, 3, 3) that were used.
    report : BakeReport
        What was chosen and measured.
    """

    ao: Float32Array = field(repr=False)
    valid: BoolArray = field(repr=False)
    mesh: BakedMesh
    report: BakeReport
    _baked: Baked = field(repr=False)
    _options: BakeOptions = field(repr=False)

    def save(
        self,
        output: Output,
        *,
        mesh_output: Output | None = None,
        report: Output | None = None,
        progress: Progress | None = None,
    ) -> BakeFiles:
        """Write the texture and the mesh, as the command line does.

        All files appear, or none. A mesh from a file keeps what else the file holds; one from arrays becomes a GLB.

        Parameters
        ----------
        output : str or path-like
            The texture, its format by the extension, or a folder: one that exists, or a name that ends in a slash,
            which is made. There the texture is ``<name>_ao.png``.
        mesh_output : str or path-like, optional
            The mesh, its format by the extension, or a folder. By default ``<name>_ao.<ext>`` beside the texture.
        report : str or path-like, optional
            A JSON file for the report, or a folder.
        progress : Progress, optional
            Receives warnings about what the mesh's format cannot hold.

        Returns
        -------
        BakeFiles
            Paths of the texture and of the mesh.

        Raises
        ------
        UsageError
            If an extension is unknown, or an output would replace a file of the input.
        OutputError
            If a file cannot be written.
        """
        plan = _FilePlan(self._baked.scene, self.mesh.name, output, mesh_output, report, self._options)
        with Outputs() as outputs:
            outputs.protect(source_files(self._baked.scene))
            plan.claim(outputs)
            files, messages = plan.write(outputs, self._baked)
            if plan.report is not None:
                document = replace(
                    self.report,
                    outputs=_report_outputs(files, outputs),
                    warnings=(*self.report.warnings, *warnings_of(messages)),
                    notes=(*self.report.notes, *notes_of(messages)),
                )
                write_json(outputs.path(plan.report), document.to_dict())
        tell(progress or Progress(), messages)
        return files


def bake(
    mesh: MeshLike, options: BakeOptions | None = None, *, verify: bool = False, progress: Progress | None = None
) -> BakeResult:
    """Bake the ambient occlusion of a mesh into a texture, in memory.

    The value of a surface point is the cosine-weighted share of the directions in front of it along which it sees out
    of the scene: 1 is open, 0 is closed.

    Parameters
    ----------
    mesh : Mesh, str, path-like or trimesh.Trimesh
        A mesh, or the path of a mesh file.
    options : BakeOptions, optional
        Size of the texture, number of directions and so on.
    verify : bool
        Measure the texture against ray tracing, for the report.
    progress : Progress, optional
        Receives stages, notes and warnings.

    Returns
    -------
    BakeResult
        The texture, the mesh with its UVs, and a report.

    Raises
    ------
    ArgumentError
        If `mesh` is no mesh.
    InputError
        If the mesh cannot be used, or not be unwrapped as asked.
    UsageError
        If the size is beyond the renderer or too small for the charts, or an unwrapper is not installed.
    RendererError
        If there is no way to render, see `doctor`.

    References
    ----------
    *Précalcul*, section 1.1: the integral (1.1.0.1), its estimate over uniform directions (1.1.1.1), visibility by
    depth maps (1.1.2), padding and fill (1.1.3).

    Examples
    --------
    >>> import aoprecalc as ao
    >>> result = ao.bake("car.glb", ao.BakeOptions(size=1024))  # doctest: +SKIP
    >>> result.save("build/")  # doctest: +SKIP
    """
    options, progress = given_or_default(options, BakeOptions), progress or Progress()
    timer = StageTimer(progress)
    if verify:
        require_embreex()
    with timer.stage("load"):
        mesh = as_mesh(mesh)
    baked = bake_scene(mesh._scene, options, progress, timer)
    errors = _measure(baked, baked.texture.values, options, progress, timer) if verify else None
    messages = (*_messages(baked), *(_warn_of_shared_uvs(baked) if verify else ()))
    report = bake_report(baked, options, BakeOutputs(), errors, timer.seconds(), messages)
    tell(progress, messages)
    ao = baked.texture.values
    textured = BakedMesh.of(mesh, baked, output_uvs(baked.scene, baked.atlas))
    return BakeResult(ao, baked.texture.valid, textured, report, baked, options)


# From file to files, as the command line and the batch do it.


@dataclass(frozen=True, eq=False)
class FileBake:
    """A bake that was written: the paths of its files, the bake itself and its report."""

    files: BakeFiles
    baked: Baked
    report: BakeReport


def bake_file(
    mesh: Output,
    output: Output | None = None,
    *,
    mesh_output: Output | None = None,
    report: Output | None = None,
    stem: str | None = None,
    verify: bool = False,
    outputs: Outputs | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
    options: BakeOptions | None = None,
    progress: Progress | None = None,
) -> FileBake:
    """Bake a mesh file and write the texture and the mesh; outputs are checked before the work.

    output            the texture or a folder, see `BakeResult.save`; by default <stem>_ao.png in the current folder
    stem              of default names; None: the mesh's
    verify            measure the texture that was written, for the report
    outputs           receives the files, which the caller then moves to their places; None: they appear at the end
    make_visibility   see `bake_scene`
    Either all files appear, or none and what `bake` and `BakeResult.save` raise is raised.
    """
    options, progress = options or BakeOptions(), progress or Progress()
    mesh, timer = Path(mesh), StageTimer(progress)
    stem = stem or mesh.stem
    texture = output_path(output, f"{stem}_ao.png")
    choose_bit_depth(texture, options.bit_depth)
    if verify:
        require_embreex()
    with Outputs() if outputs is None else nullcontext(outputs) as outputs:
        outputs.protect([mesh])
        claim_output(outputs, output, texture)
        with timer.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        plan = _FilePlan(scene, stem, output, mesh_output, report, options)
        plan.claim(outputs, texture=False)
        baked = bake_scene(scene, options, progress, timer, make_visibility)
        with timer.stage("write"):
            files, messages = plan.write(outputs, baked)
        messages = (*_messages(baked), *messages)
        errors = None
        if verify:
            errors = _measure(baked, read_image(outputs.written(files.texture)), options, progress, timer)
            messages += _warn_of_shared_uvs(baked)
        names = _report_outputs(files, outputs)
        document = bake_report(baked, options, names, errors, timer.seconds(), messages)
        if plan.report is not None:
            write_json(outputs.path(plan.report), document.to_dict())
    tell(progress, messages)
    return FileBake(files, baked, document)


class _FilePlan:
    """Where the files of a bake go; raises UsageError for names that cannot be written."""

    def __init__(
        self,
        scene: Scene,
        stem: str,
        output: Output | None,
        mesh_output: Output | None,
        report: Output | None,
        options: BakeOptions,
    ) -> None:
        self._stem, self._output, self._mesh_output, self._report = stem, output, mesh_output, report
        self._options = options
        self.texture = output_path(output, f"{stem}_ao.png")
        choose_bit_depth(self.texture, options.bit_depth)
        self.mesh = self._mesh_path(output_mesh_extension(scene)[0])
        self.report = None if report is None else output_path(report, f"{stem}_report.json", "report")

    def claim(self, outputs: Outputs, *, texture: bool = True) -> None:
        """Make sure that the files can be written."""
        if texture:
            claim_output(outputs, self._output, self.texture)
        claim_output(outputs, self._mesh_output, self.mesh)
        if self.report is not None:
            claim_output(outputs, self._report, self.report)

    def write(self, outputs: Outputs, baked: Baked) -> tuple[BakeFiles, tuple[str, ...]]:
        """Write the texture and the mesh; return their paths, and warnings and notes about the mesh."""
        suffix, reason = output_mesh_extension(baked.scene, baked.atlas)
        path = self._mesh_path(suffix)
        text = options_text(baked.options)
        write_image(outputs.path(self.texture), baked.texture.values, self._options.bit_depth, text)
        messages = write_baked_mesh(
            outputs,
            path,
            baked.scene,
            baked.atlas,
            baked.normals,
            self.texture,
            pack=self._options.pack,
            options=baked.options,
        )
        reasons = (Note(reason),) if reason and self._mesh_output is None else ()
        return BakeFiles(self.texture, path), (*messages, *reasons)

    def _mesh_path(self, suffix: str) -> Path:
        default = self.texture.parent / f"{self._stem}_ao{suffix}"
        path = output_path(self._mesh_output, default, "mesh_output")
        check_mesh_extension(path, self._options.pack)
        return path


def _report_outputs(files: BakeFiles, outputs: Outputs) -> BakeOutputs:
    """Name the files; `others` go with the mesh (.mtl, .bin, images)."""
    named = {files.texture.resolve(), files.mesh.resolve()}
    others = sorted(str(files.mesh.parent / path.name) for path in outputs.files if path not in named)
    return BakeOutputs(str(files.texture), str(files.mesh), tuple(others))


def _measure(
    baked: Baked, texture: Float32Array, options: BakeOptions, progress: Progress, timer: StageTimer
) -> TextureErrors:
    """Measure a texture of the bake against ray tracing."""
    how = VerifyOptions(threads=options.threads)
    with timer.stage("verify", how.points, "points"):
        return measure_texture(
            baked.scene, baked.atlas, baked.normals, texture, how, progress, estimator=options.estimator
        )


def _messages(baked: Baked) -> tuple[str, ...]:
    """Return the warnings and notes about the input and the bake."""
    scene = baked.scene
    return (*scene.warnings, *baked.warnings, *scene.notes, *baked.notes)


def _warn_of_shared_uvs(baked: Baked) -> tuple[str, ...]:
    return warn_of_shared_uvs(baked.scene) if any(part.uv_owner is not None for part in baked.scene.parts) else ()
