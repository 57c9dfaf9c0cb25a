"""The figures of the report *Précalcul* for a mesh, in memory and as files."""

from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from aoprecalc.api.mesh import Mesh
from aoprecalc.api.sphere_quality import SphereQuality
from aoprecalc.api.textured_surface import mesh_to_draw
from aoprecalc.errors import ArgumentError, OutputError, counted
from aoprecalc.io import Outputs
from aoprecalc.io.formats.builder import numbers
from aoprecalc.io.images import picture_png, write_colors
from aoprecalc.io.outputs import output_path
from aoprecalc.options import BakeOptions, Method, PreviewOptions, SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.render.camera import PictureFrame, view_axes
from aoprecalc.render.figures import Figure, FittedSpheres, bake_figures, figure_sheet, sphere_figures, trace_direction
from aoprecalc.render.preview import preview_pictures
from aoprecalc.spheres import fit_sphere_set
from aoprecalc.spheres.fit import surface_samples
from aoprecalc.types import Baked, Float32Array, Float64Array, Picture, Scene, SphereSet

_COLUMNS = 3  # of a sheet
_SIDE = 1024  # pixels of the rendered mesh
_PANEL = (900, 720)  # of figure 1.5
_SOURCE_METHODS: tuple[Method, ...] = ("lloyd", "algebraic")  # of the report

BAKE_FIGURES = ("1_1_near", "1_1_far", "1_2", "1_3", "1_4_without", "1_4")


@dataclass(frozen=True, eq=False)
class Figures:
    """The figures of the report *Précalcul* for one mesh.

    Attributes
    ----------
    pictures : dict of str to ndarray, (height, width, 3) uint8
        Each figure by its number, such as ``"1_2"``; sRGB, row 0 on top.
    sheet : ndarray, (height, width, 3) uint8
        All of them, with captions.
    """

    sheet: Picture = field(repr=False)
    _figures: tuple[Figure, ...] = field(repr=False)
    _name: str

    @property
    def pictures(self) -> dict[str, Picture]:
        """Each figure by its number."""
        return {figure.name: figure.picture for figure in self._figures}

    def save(self, folder: str | PathLike[str]) -> tuple[Path, ...]:
        """Write the figures and the sheet as PNG, all of them or none.

        Parameters
        ----------
        folder : str or path-like
            Is made where it is missing. The files are ``<name>_figure_<number>.png`` and ``<name>_figures.png``; of
            spheres the sheet is ``<name>_sphere_figures.png``.

        Returns
        -------
        tuple of Path
            The files, the sheet last.

        Raises
        ------
        OutputError
            If a file cannot be written.
        """
        files = FigureFiles.plan(folder, self._name, tuple(figure.name for figure in self._figures))
        with Outputs() as outputs:
            files.claim(outputs)
            files.write(outputs, self)
        return files.paths

    def _repr_png_(self) -> bytes:
        """Show the sheet in a notebook."""
        return picture_png(self.sheet)


@dataclass(frozen=True, eq=False)
class BakeFigures(Figures):
    """The figures 1.1 to 1.4 of a bake.

    Attributes
    ----------
    direction : ndarray, (3,) float64
        The unit vector w towards the light.
    depths : ndarray, (2, s, s) float64
        The greatest and the least p.w of the points p of the surface at the centre of each pixel of figure 1.1, in the
        mesh's units; NaN where there is none. Row 0 is on top.
    pixel : float
        The side of such a pixel, in the mesh's units.
    visibility : ndarray, (H, W) float32
        The values of figure 1.2: max(0, n.w) where the surface sees the light, else 0. Row 0 is v = 1.
    """

    direction: Float64Array
    depths: Float64Array = field(repr=False)
    pixel: float
    visibility: Float32Array = field(repr=False)


def figures_of_bake(
    baked: Baked, options: BakeOptions, direction: ArrayLike | None, name: str, progress: Progress
) -> BakeFigures:
    """Draw the figures of a bake: see `BakeResult.figures`."""
    drawn = mesh_to_draw(baked)
    to_y_up = PictureFrame.from_positions(baked.scene.positions, drawn.up).rotation
    look = PreviewOptions(size=_SIDE, up=drawn.up, backend=options.backend, threads=options.threads)
    if direction is None:
        towards = view_axes(look.azimuth, look.elevation)[2] @ to_y_up
    else:
        towards = numbers("direction", direction, (3,))
        if not towards.any():
            raise ArgumentError("direction", "is 0, 0, 0; expected three numbers, not all 0")
    towards = towards / np.abs(towards).max()  # so that the length is finite and not 0
    traced = trace_direction(baked, options, towards / np.linalg.norm(towards), to_y_up[1])
    clay, rendered = (
        preview_pictures(drawn.mesh, None, replace(look, shading=shading), progress)[0] for shading in ("clay", "ao")
    )
    figures = bake_figures(baked, options, traced, clay, rendered)
    sheet = figure_sheet(figures, _COLUMNS, _title(baked.scene, name))
    return BakeFigures(sheet, figures, name, traced.direction, traced.depths, traced.pixel, traced.visibility.values)


def sphere_figure_names(method: Method) -> tuple[str, ...]:
    """Return the names of the figures of a fit: those methods are shown that the report has, and this one."""
    return tuple(f"1_5_{name}" for name in ("samples", "mesh", *_methods_shown(method)))


def _methods_shown(method: Method | str) -> tuple[Method | str, ...]:
    """Return the methods whose spheres are drawn: those of the report come last, side by side."""
    return _SOURCE_METHODS if method in _SOURCE_METHODS else (method, *_SOURCE_METHODS)


def figures_of_spheres(
    scene: Scene, spheres: SphereSet, quality: SphereQuality, name: str, progress: Progress
) -> Figures:
    """Draw the figures of spheres that were fitted to a scene: see `SphereResult.figures`."""
    found = {spheres.method: FittedSpheres(spheres, quality.silhouette_iou, quality.surface_error_mean)}
    for method in _SOURCE_METHODS:
        if method not in found:
            options = SphereOptions(len(spheres), method=method, samples=spheres.samples, seed=spheres.seed)
            other, measured = fit_sphere_set(scene, options, Progress())
            found[method] = FittedSpheres(other, measured["silhouette_iou"], measured["surface_error_mean"])
    mesh = mesh_to_draw(Mesh._of(scene, scene.positions, scene.faces, name))
    look = PreviewOptions(size=_PANEL, up=mesh.up, ground=True, shading="clay")
    samples = surface_samples(scene, spheres.samples, spheres.seed)
    fitted = [found[method] for method in _methods_shown(spheres.method)]
    figures = sphere_figures(mesh.mesh, samples, fitted, look, progress)
    columns = 2 if len(figures) % 2 == 0 else _COLUMNS
    return Figures(figure_sheet(figures, columns, _title(scene, name)), figures, name)


def _title(scene: Scene, name: str) -> str:
    return f"{scene.path.name or name}: {counted(len(scene.faces), 'triangle')}"


@dataclass(frozen=True)
class FigureFiles:
    """Where the files of figures go.

    folder   is made where it is missing
    paths    of the figures, in their order, and of the sheet
    """

    folder: Path
    paths: tuple[Path, ...]

    @classmethod
    def plan(cls, folder: str | PathLike[str], stem: str, names: tuple[str, ...]) -> "FigureFiles":
        """Return the files of figures of some names, for a mesh of a given stem; raises ArgumentError for no path."""
        output_path(folder, stem, "figures")
        inside = Path(folder)
        figures = [inside / f"{stem}_figure_{name}.png" for name in names]
        sheet = f"{stem}_figures.png" if names == BAKE_FIGURES else f"{stem}_sphere_figures.png"
        return cls(inside, (*figures, inside / sheet))

    def claim(self, outputs: Outputs) -> None:
        """Make the folder, and make sure that all files can be written; see Outputs.claim."""
        if self.folder.exists() and not self.folder.is_dir():
            raise OutputError(f"{self.folder}: is a file, a folder for figures was expected; choose another")
        outputs.folder(self.folder)
        for path in self.paths:
            outputs.claim(path)

    def write(self, outputs: Outputs, figures: Figures) -> None:
        """Write the figures and their sheet."""
        for path, picture in zip(self.paths, (*figures.pictures.values(), figures.sheet), strict=True):
            write_colors(outputs.path(path), picture)
