"""Bake ambient occlusion: from a mesh to its texture in memory, and from a mesh file to files."""

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from aoprecalc.api.bake_files import BakeFiles, Output, plan_bake
from aoprecalc.api.bake_report import bake_report
from aoprecalc.api.bake_textures import BakedTexture, BakedTextures, bake_textures
from aoprecalc.api.bent_normals import bent_normals, spherical_harmonics
from aoprecalc.api.high_to_low import detailed_meshes, names_of
from aoprecalc.api.mesh import BakedMesh, MeshLike, as_mesh, given_or_default
from aoprecalc.api.prepared_scene import PreparedScene
from aoprecalc.api.reports import BakeOutputs, BakeReport
from aoprecalc.api.verify import measure_texture, notes_on_shared_uvs
from aoprecalc.errors import ArgumentError, counted
from aoprecalc.io import Outputs, load_scene, source_files
from aoprecalc.io.formats.textures import output_uvs
from aoprecalc.io.images import png_bytes
from aoprecalc.io.outputs import write_json
from aoprecalc.metrics.errors import TextureErrors
from aoprecalc.notebook import figure, image
from aoprecalc.options import BakeOptions, PreviewOptions, VerifyOptions, names_extensions
from aoprecalc.options.fields import option_files
from aoprecalc.progress import Progress, StageTimer, notes_of, tell, warnings_of
from aoprecalc.types import Baked, BoolArray, Float32Array, Picture
from aoprecalc.visibility.rays import require_embreex
from aoprecalc.visibility.source import LocalVisibility, VisibilityFactory

if TYPE_CHECKING:
    from aoprecalc.api.figures import BakeFigures


@dataclass(frozen=True, eq=False)
class BakeResult:
    """An ambient-occlusion texture and the mesh that it belongs to.

    Attributes
    ----------
    ao : ndarray, (H, W) float32
        Ambient occlusion in [0, 1], 1 is open; row 0 is v = 1. Padded and filled, see `BakeOptions`. Several textures
        are below each other here, as the UVs of `mesh` take them.
    valid : ndarray, (H, W) bool
        Texels that the surface covers and whose value was measured.
    mesh : BakedMesh
        The `Mesh` with the UVs (F, 3, 2) of the texture and the normals (F, 3, 3) that were used.
    report : BakeReport
        What was chosen and measured.
    vertex_ao : ndarray, (F, 3) float32, or None
        Ambient occlusion in [0, 1] at the corners of the faces, equal at corners of one position and shading normal:
        the values whose interpolation over the faces is nearest to the texture. None without the option `vertex_ao`.
    textures : tuple of BakedTexture
        Each by itself; one, unless the option `textures` asks for several, or the UVs lie on UDIM tiles.
    """

    ao: Float32Array = field(repr=False)
    valid: BoolArray = field(repr=False)
    mesh: BakedMesh
    report: BakeReport
    vertex_ao: Float32Array | None = field(repr=False)
    textures: tuple[BakedTexture, ...] = field(repr=False)
    _bake: BakedTextures = field(repr=False)
    _options: BakeOptions = field(repr=False)

    @cached_property
    def bent_normals(self) -> Float32Array | None:
        """(H, W, 3) float32 unit vectors in the mesh's coordinates, padded as `ao`; None without that option.

        The mean of the visible directions, weighted as in the AO; where nothing is visible, the shading normal.
        """
        return self._bake.each(bent_normals, self._options) if self._options.bent_normals else None

    @cached_property
    def sh(self) -> Float32Array | None:
        """(H, W, 4) float32, visibility in spherical harmonics of degree 1; None without the option `bent_normals`.

        The AO and a vector C: where the light from each unit vector w is L0 + L1.w, a point gets AO L0 + C.L1 of it.
        """
        return self._bake.each(spherical_harmonics, self._options) if self._options.bent_normals else None

    @names_extensions
    def save(
        self,
        output: Output,
        *,
        mesh_output: Output | None = None,
        report: Output | None = None,
        bent_normals: Output | None = None,
        sh: Output | None = None,
        progress: Progress | None = None,
    ) -> BakeFiles:
        """Write the texture and the mesh, as the command line does.

        All files appear, or none. A mesh from a file keeps what else the file holds; one from arrays becomes a GLB.
        With the option `invert` the picture holds 1 - `ao`.

        Parameters
        ----------
        output : str or path-like
            What is written, by the extension. An image ({images}): the texture; the mesh is beside it under the same
            stem. A mesh ({baked meshes}): the mesh; a .glb or .usdz has the texture inside, the others
            have it beside them as ``<stem>_ao.png``, or ``<stem>.png`` where the stem ends in ``_ao``. A folder, which
            exists or whose name ends in a slash: then it is made, and the texture in it is ``<name>_ao.png``.
        mesh_output : str or path-like, optional
            The mesh, its format by the extension, or a folder, where `output` is the texture.
        report : str or path-like, optional
            A JSON file for the report, or a folder.
        bent_normals, sh : str or path-like, optional
            Pictures of the bent normals and of spherical harmonics ({images}), where the options ask for these.
        progress : Progress, optional
            Receives warnings about what the mesh's format cannot hold.

        Returns
        -------
        BakeFiles
            Paths of the texture, which is None where it is inside a GLB, and of the mesh.

        Raises
        ------
        UsageError
            If an extension is unknown, or an output would replace a file of the input.
        OutputError
            If a file cannot be written.
        """
        if not self._options.bent_normals and not (bent_normals is sh is None):
            raise ArgumentError("bent_normals", "and sh need a bake with BakeOptions(bent_normals=True); bake again")
        plan = plan_bake(self.mesh.name, output, mesh_output, report, self._options, bent_normals, sh)
        scene = self._baked.scene
        with Outputs() as outputs, TemporaryDirectory() as scratch:
            outputs.protect([*source_files(scene), *map(Path, option_files(self._options))])
            plan.claim(outputs)
            plan.claim_mesh(outputs, scene)
            written = plan.write(outputs, self._bake, Path(scratch))
            if plan.report is not None:
                document = replace(
                    self.report,
                    outputs=written.outputs(outputs),
                    warnings=(*self.report.warnings, *warnings_of(written.messages)),
                    notes=(*self.report.notes, *notes_of(written.messages)),
                )
                write_json(outputs.path(plan.report.path), document.to_dict())
        tell(progress or Progress(), written.messages)
        return written.files

    @property
    def _baked(self) -> Baked:
        return self._bake.whole

    def preview(self, options: PreviewOptions | None = None) -> Picture:
        """Draw the mesh with its texture, in the strength of the bake's options, as viewers show a glTF of it.

        Parameters
        ----------
        options : PreviewOptions, optional
            Size, shading, camera and so on.

        Returns
        -------
        ndarray, (height, width, 3) uint8
            sRGB, row 0 on top; the contact sheet of several views, the first frame of a turntable.

        Raises
        ------
        RendererError
            If there is no way to render, see `doctor`.
        """
        from aoprecalc.api.preview import preview_of_bake

        return preview_of_bake(self._baked, self._options.strength, options)

    @cached_property
    def _shown(self) -> bytes | None:
        """The picture that notebooks show, as PNG; None where it cannot be drawn."""
        from aoprecalc.api.preview import notebook_png

        return notebook_png(lambda: self.preview(PreviewOptions(size=(600, 450))))

    def _repr_png_(self) -> bytes | None:
        """Show the mesh with its texture in a notebook."""
        return self._shown

    def _repr_html_(self) -> str | None:
        """Show the mesh with its texture, and the texture, in a notebook, with a line of figures."""
        if self._shown is None:
            return None
        report, name = self.report, self.mesh.name
        line = (
            f"{name}: {report.texels.width} x {report.texels.height} texels, mean AO {report.ao.mean:.3f}, "
            f"{report.sampled}, {counted(report.input.triangles, 'triangle')}, "
            f"{counted(self._baked.atlas.charts, 'chart')}"
        )
        texture = png_bytes(self.ao)
        return figure([image(self._shown, f"{name} with its AO", 450), image(texture, f"AO of {name}", 450)], line)

    def figures(self, direction: ArrayLike | None = None, *, progress: Progress | None = None) -> "BakeFigures":
        """Draw the figures of the report *Précalcul* for this mesh.

        They are 1.1, the depth map along one direction, from both sides; 1.2, that direction in texture space; 1.3, the
        finished texture; 1.4, the mesh rendered with it; and a sheet of them all.

        Parameters
        ----------
        direction : array_like, (3,), optional
            Towards the light, in the mesh's coordinates, of any length but 0. By default that of `FigureOptions`.
        progress : Progress, optional
            Receives stages.

        Returns
        -------
        BakeFigures
            Pictures, and the values that 1.1 and 1.2 show; `save` writes them.

        Raises
        ------
        ArgumentError
            If `direction` is not three finite numbers, or is 0.
        RendererError
            If there is no way to render, see `doctor`.
        """
        from aoprecalc.api.figures import figures_of_bake

        return figures_of_bake(self._baked, self._options, direction, self.mesh.name, progress or Progress())


def bake(
    mesh: MeshLike,
    options: BakeOptions | None = None,
    *,
    high: Sequence[MeshLike] = (),
    verify: bool = False,
    progress: Progress | None = None,
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
    high : sequence of Mesh, str, path-like or trimesh.Trimesh
        Detailed meshes whose ambient occlusion goes into the texture, as from the files of `BakeOptions.high`.
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
        If `mesh` is not a mesh.
    InputError
        If the mesh cannot be used, or not be unwrapped as asked.
    UsageError
        If the size is beyond the renderer or too small for the charts, or an unwrapper is not installed.
    RendererError
        If there is no way to render, see `doctor`.

    References
    ----------
    *Précalcul*, section 1.1: the integral (equation 1.1.0.1, over the whole sphere 1.1.1.1), its estimate from uniform
    directions (section 1.1.1), visibility by depth maps (1.1.2), padding and fill (1.1.3).

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
        mesh, details = as_mesh(mesh), detailed_meshes(high, options)
    options = replace(options, high=names_of(details)) if details else options
    bake = bake_textures(mesh._scene, options, progress, timer, high=details)
    baked, texture = bake.whole, bake.whole.texture
    errors = _measure(baked, texture.values, options, progress, timer) if verify else None
    messages = (*_messages(baked), *(_notes_on_shared_uvs(baked) if verify else ()))
    report = bake_report(baked, options, BakeOutputs(), errors, timer.seconds(), messages, bake.named)
    tell(progress, messages)
    textured = BakedMesh.of(mesh, baked, output_uvs(baked.scene, baked.atlas))
    textures = tuple(each.result() for each in bake.textures)
    return BakeResult(texture.values, texture.valid, textured, report, baked.vertex_ao, textures, bake, options)


# From file to files, as the command line and the batch do it.


@dataclass(frozen=True, eq=False)
class FileBake:
    """A bake that was written: the paths of its files, the bake itself and its report."""

    files: BakeFiles
    baked: Baked
    report: BakeReport


def bake_file(
    mesh: Output,
    output: Output | tuple[Output, ...] | None = None,
    *,
    mesh_output: Output | None = None,
    report: Output | None = None,
    bent_normals: Output | None = None,
    sh: Output | None = None,
    stem: str | None = None,
    verify: bool = False,
    figures: Output | None = None,
    figure_direction: tuple[float, float, float] | None = None,
    outputs: Outputs | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
    options: BakeOptions | None = None,
    progress: Progress | None = None,
) -> FileBake:
    """Bake a mesh file and write the texture and the mesh; outputs are checked before the work.

    output            see `BakeResult.save`, or an image and a mesh; by default <stem>_ao.png in the current folder
    bent_normals, sh  see `BakeResult.save`; the bake measures what they hold
    stem              of default names; None: the mesh's
    verify            measure the texture that was written, for the report
    figures           a folder for the figures, see `BakeResult.figures`, whose names begin with the stem; None: none
    figure_direction  see `FigureOptions`
    outputs           receives the files, which the caller then moves to their places; None: they appear at the end
    make_visibility   see `bake_prepared`
    Either all files appear, or none and what `bake` and `BakeResult.save` raise is raised.
    """
    options, progress = options or BakeOptions(), progress or Progress()
    mesh, timer = Path(mesh), StageTimer(progress)
    if bent_normals is not None or sh is not None:
        options = replace(options, bent_normals=True)
    plan = plan_bake(stem or mesh.stem, output, mesh_output, report, options, bent_normals, sh)
    drawn = None
    if figures is not None:
        from aoprecalc.api.figures import BAKE_FIGURES, FigureFiles, figures_of_bake

        drawn = FigureFiles.plan(figures, stem or mesh.stem, BAKE_FIGURES)
    if verify:
        require_embreex()
    with Outputs() if outputs is None else nullcontext(outputs) as outputs, TemporaryDirectory() as scratch:
        outputs.protect([mesh, *map(Path, option_files(options))])
        plan.claim(outputs)
        if drawn is not None:
            drawn.claim(outputs)
        with timer.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        plan.claim_mesh(outputs, scene)
        bake = bake_textures(scene, options, progress, timer, make_visibility)
        baked = bake.whole
        with timer.stage("write"):
            written = plan.write(outputs, bake, Path(scratch))
        named = written.outputs(outputs)
        if drawn is not None:
            with timer.stage("figures"):
                drawn.write(outputs, figures_of_bake(baked, options, figure_direction, mesh.stem, Progress()))
            named = replace(named, figures=tuple(map(str, drawn.paths)))
        messages = (*_messages(baked), *written.messages, *(_notes_on_shared_uvs(baked) if verify else ()))
        errors = _measure(baked, bake.join(written.values()), options, progress, timer) if verify else None
        document = bake_report(baked, options, named, errors, timer.seconds(), messages, bake.named)
        if plan.report is not None:
            write_json(outputs.path(plan.report.path), document.to_dict())
    tell(progress, messages)
    return FileBake(written.files, baked, document)


def _measure(
    baked: Baked, texture: Float32Array, options: BakeOptions, progress: Progress, timer: StageTimer
) -> TextureErrors:
    """Measure a texture of the bake against ray tracing."""
    how = VerifyOptions(threads=options.threads)
    with timer.stage("verify", how.points, "points"):
        return measure_texture(
            PreparedScene(baked.scene, baked.normals), baked.atlas, texture, how, progress, value=options
        )


def _messages(baked: Baked) -> tuple[str, ...]:
    """Return the warnings and notes about the input and the bake."""
    scene = baked.scene
    return (*scene.warnings, *baked.warnings, *scene.notes, *baked.notes)


def _notes_on_shared_uvs(baked: Baked) -> tuple[str, ...]:
    return notes_on_shared_uvs(baked.scene) if any(part.uv_owner is not None for part in baked.scene.parts) else ()
