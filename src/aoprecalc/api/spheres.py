"""Fit spheres that stand in for a mesh, and measure spheres of any origin: in memory, and from file to file."""

import json
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from aoprecalc.api.mesh import Mesh, MeshLike, as_mesh, given_or_default
from aoprecalc.api.sphere_quality import SphereQuality
from aoprecalc.errors import ArgumentError, InputError, listed_counts
from aoprecalc.io import Outputs, checked_spheres, load_scene, source_files
from aoprecalc.io.outputs import claim_output, output_path
from aoprecalc.io.sphere_files import (
    check_sphere_extension,
    read_levels,
    read_spheres,
    sphere_document,
    write_sphere_set,
)
from aoprecalc.notebook import figure, image
from aoprecalc.options import PreviewOptions, SphereOptions, names_extensions
from aoprecalc.progress import Progress, tell
from aoprecalc.spheres import fit_sphere_set, measure_quality
from aoprecalc.types import Float64Array, Picture, Scene, SphereSet

if TYPE_CHECKING:
    from aoprecalc.api.figures import Figures

Output = str | PathLike[str]


@dataclass(frozen=True, eq=False)
class SphereResult:
    """Spheres that stand in for a mesh.

    Attributes
    ----------
    spheres : SphereSet
        The spheres and how they were fitted; coarser levels, if asked for, are in `SphereSet.coarser`.
    quality : SphereQuality
        How well they stand in for the mesh.
    centers : ndarray, (n, 3) float64
        In the mesh's coordinates.
    radii : ndarray, (n,) float64
        In the mesh's units, >= 0.
    """

    spheres: SphereSet
    quality: SphereQuality
    _scene: Scene = field(repr=False)
    _name: str = field(repr=False)

    @property
    def centers(self) -> Float64Array:
        """Centres in the mesh's coordinates, (n, 3) float64."""
        return self.spheres.centers

    @property
    def radii(self) -> Float64Array:
        """Radii in the mesh's units, (n,) float64."""
        return self.spheres.radii

    def __len__(self) -> int:
        return len(self.spheres)

    def to_json(self) -> str:
        """Return the JSON text that `save` writes to a .json file."""
        return sphere_document(self.spheres, self.quality.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """Return the document of `to_json`."""
        document: dict[str, Any] = json.loads(self.to_json())
        return document

    @names_extensions
    def save(self, output: str | PathLike[str]) -> Path:
        """Write the spheres, as the command line does.

        Parameters
        ----------
        output : str or path-like
            A file, its format by the extension ({sphere sets}), or a folder: one that exists, or a name that ends in a
            slash, which is made. There it is ``<name>_spheres.json``.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        UsageError
            If the extension is unknown or cannot hold levels, or a file of the input would be replaced.
        OutputError
            If the file cannot be written.
        """
        path = _sphere_path(output, self._name, has_levels=self.spheres.coarser is not None)
        with Outputs() as outputs:
            outputs.protect(source_files(self._scene))
            claim_output(outputs, output, path)
            self._write(outputs, path)
        return path

    def preview(self, options: PreviewOptions | None = None) -> Picture:
        """Draw the mesh and the spheres.

        Parameters
        ----------
        options : PreviewOptions, optional
            Size, camera and so on.

        Returns
        -------
        ndarray, (height, width, 3) uint8
            sRGB, row 0 on top; see `aoprecalc.preview`, which raises the same errors.
        """
        from aoprecalc.api.preview import preview

        mesh = Mesh._of(self._scene, self._scene.positions, self._scene.faces, self._name)
        return preview(mesh, options, spheres=self.spheres).image

    def figures(self, *, progress: Progress | None = None) -> "Figures":
        """Draw figure 1.5 of the report *Précalcul* for this mesh.

        They show the samples of its surface, the mesh, and as many spheres by each of the report's methods, lloyd and
        algebraic, and by the method that was used if it is another, each with its soft shadow; and a sheet of them all.

        Parameters
        ----------
        progress : Progress, optional
            Receives stages.

        Returns
        -------
        Figures
            Pictures; `save` writes them.

        Raises
        ------
        RendererError
            If there is no way to render, see `doctor`.
        """
        from aoprecalc.api.figures import figures_of_spheres

        return figures_of_spheres(self._scene, self.spheres, self.quality, self._name, progress or Progress())

    @cached_property
    def _shown(self) -> bytes | None:
        """The picture that notebooks show, as PNG; None where it cannot be drawn."""
        from aoprecalc.api.preview import notebook_png

        return notebook_png(lambda: self.preview(PreviewOptions(size=(760, 380))))

    def _repr_png_(self) -> bytes | None:
        """Show the mesh beside the spheres in a notebook."""
        return self._shown

    def _repr_html_(self) -> str | None:
        """Show the mesh beside the spheres in a notebook, with a line of figures."""
        if self._shown is None:
            return None
        quality = self.quality
        error = f"surface error {quality.surface_error_mean:.4f} of the diagonal"
        line = f"{len(self)} spheres by {self.spheres.method}: silhouette IoU {quality.silhouette_iou:.3f}, {error}"
        return figure([image(self._shown, f"{self._name} beside {line}", 380)], line)

    def _write(self, outputs: Outputs, path: Path) -> None:
        write_sphere_set(outputs.path(path), self.spheres, self.quality.to_dict(), self._scene)


def fit_spheres(
    mesh: MeshLike, options: SphereOptions | None = None, *, progress: Progress | None = None
) -> SphereResult:
    """Fit spheres to a mesh, for casting its soft shadows or for collisions.

    The same mesh and options give the same spheres.

    Parameters
    ----------
    mesh : Mesh, str, path-like or trimesh.Trimesh
        A mesh, or the path of a mesh file.
    options : SphereOptions, optional
        Number of spheres, method and so on.
    progress : Progress, optional
        Receives stages and warnings.

    Returns
    -------
    SphereResult
        Centres, radii and quality.

    Raises
    ------
    ArgumentError
        If `mesh` is not a mesh.
    InputError
        If the mesh cannot be used, or has too few distinct points.
    AoprecalcError
        If no number of spheres reaches `SphereOptions.tolerance`.

    References
    ----------
    *Précalcul*, section 1.2: sampling (1.2.1), Lloyd's iteration (algorithm 1.2.1) with the algebraic metric (1.2.2.1,
    1.2.2.2) or the centre distance (1.2.2.3, 1.2.2.4).

    Examples
    --------
    >>> import aoprecalc as ao
    >>> spheres = ao.fit_spheres("car.glb", ao.SphereOptions(64, method="shadow"))  # doctest: +SKIP
    >>> spheres.centers.shape, spheres.quality.silhouette_iou  # doctest: +SKIP
    """
    options, progress = given_or_default(options, SphereOptions), progress or Progress()
    with progress.stage("load"):
        mesh = as_mesh(mesh)
    result = _fit(mesh._scene, mesh.name, options, progress)
    _warn(mesh._scene, progress)
    return result


def measure_spheres(
    mesh: MeshLike,
    centers: ArrayLike,
    radii: ArrayLike,
    options: SphereOptions | None = None,
    *,
    progress: Progress | None = None,
) -> SphereQuality:
    """Measure how well spheres, of any origin, stand in for a mesh.

    Parameters
    ----------
    mesh : Mesh, str, path-like or trimesh.Trimesh
        A mesh, or the path of a mesh file.
    centers : array_like, (n, 3)
        In the mesh's coordinates; at least one.
    radii : array_like, (n,)
        In the mesh's units, >= 0.
    options : SphereOptions, optional
        Of these only `samples`, `seed` and `all_parts` count.
    progress : Progress, optional
        Receives stages and warnings.

    Returns
    -------
    SphereQuality

    Raises
    ------
    ArgumentError
        If `mesh` is not a mesh, or `centers` and `radii` are not spheres.
    InputError
        If the mesh cannot be used.

    Examples
    --------
    >>> import aoprecalc as ao
    >>> quality = ao.measure_spheres("car.glb", *ao.load_spheres("car.json"))  # doctest: +SKIP
    """
    options, progress = given_or_default(options, SphereOptions), progress or Progress()
    points, lengths = checked_spheres(centers, radii)
    with progress.stage("load"):
        mesh = as_mesh(mesh)
    quality = _measure(mesh._scene, points, lengths, options, progress)
    if quality is None:
        raise ArgumentError("centers", f"are too far from {mesh.name} to be measured; do they belong to it?")
    return quality


@names_extensions
def load_spheres(path: str | PathLike[str]) -> tuple[Float64Array, Float64Array]:
    """Read the centres and radii of a sphere file.

    Parameters
    ----------
    path : str or path-like
        A sphere set of any program ({sphere sets}). Of .obj and .glb the objects that are spheres count; of .urdf the
        sphere collisions, all joints at position zero; of .yml and .yaml (cuRobo) the spheres of the one link that has
        any; of .usda the Sphere prims (files of other programs than this need the package usd-core).

    Returns
    -------
    centers : ndarray, (n, 3) float64
    radii : ndarray, (n,) float64

    Raises
    ------
    InputError
        If the file is missing or holds no spheres.
    """
    if not isinstance(path, str | PathLike):
        raise ArgumentError("path", f"is of type {type(path).__name__}, the path of a sphere file was expected")
    return read_spheres(Path(path))


# From file to file, as the command line and the batch do it.


def fit_spheres_file(
    mesh: str | PathLike[str],
    output: Output | tuple[Output, ...] | None = None,
    *,
    figures: Output | None = None,
    outputs: Outputs | None = None,
    options: SphereOptions | None = None,
    progress: Progress | None = None,
) -> tuple[tuple[Path, ...], SphereResult]:
    """Fit spheres to a mesh file and write them, all files or none; the outputs are checked before the work.

    output   see `SphereResult.save`, or several; by default <stem>_spheres.json in the current folder
    figures  a folder for the figures, see `SphereResult.figures`; None: none
    outputs  receives the files, which the caller then moves to their places; None: they appear at the end
    Raises what `fit_spheres` and `SphereResult.save` raise; then no file is left behind.
    """
    options, progress = options or SphereOptions(), progress or Progress()
    mesh = Path(mesh)
    given = output or (None,) if isinstance(output, tuple) else (output,)
    paths = tuple(_sphere_path(wanted, mesh.stem, has_levels=bool(options.levels)) for wanted in given)
    drawn = None
    if figures is not None:
        from aoprecalc.api.figures import FigureFiles, sphere_figure_names

        drawn = FigureFiles.plan(figures, mesh.stem, sphere_figure_names(options.method))
    with Outputs() if outputs is None else nullcontext(outputs) as outputs:
        outputs.protect([mesh])
        for wanted, path in zip(given, paths, strict=True):
            claim_output(outputs, wanted, path)
        if drawn is not None:
            drawn.claim(outputs)
        with progress.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        result = _fit(scene, mesh.stem, options, progress)
        for path in paths:
            result._write(outputs, path)
        if drawn is not None:
            with progress.stage("figures"):
                drawn.write(outputs, result.figures())
    _warn(scene, progress)
    return paths, result


def measure_sphere_file(
    mesh: str | PathLike[str], spheres: str | PathLike[str], options: SphereOptions, progress: Progress
) -> tuple[int, SphereQuality]:
    """Measure a sphere file against a mesh file; return how many spheres there are, and their quality.

    Raises InputError where either file cannot be used.
    """
    levels = read_levels(Path(spheres))
    centers, radii = levels[-1]
    if len(levels) > 1:
        counts = listed_counts([len(level[1]) for level in levels])
        progress.note(f"{spheres}: has levels of {counts} spheres; the finest is measured, {len(radii)} spheres")
    with progress.stage("load"):
        scene = load_scene(Path(mesh))
    quality = _measure(scene, centers, radii, options, progress)
    if quality is None:
        raise InputError(
            f"{spheres}: its spheres are so far from {mesh} that nothing can be measured; do they belong to it?"
        )
    return len(radii), quality


def _fit(scene: Scene, name: str, options: SphereOptions, progress: Progress) -> SphereResult:
    spheres, quality = fit_sphere_set(scene, options, progress)
    return SphereResult(spheres, SphereQuality(**quality), scene, name)


def _measure(
    scene: Scene, centers: Float64Array, radii: Float64Array, options: SphereOptions, progress: Progress
) -> SphereQuality | None:
    """Return the quality of spheres; None where they are too far from the mesh for finite numbers."""
    with np.errstate(over="ignore", invalid="ignore"):  # numbers that are not finite are checked below
        quality = measure_quality(scene, centers, radii, options, progress)
    _warn(scene, progress)
    return SphereQuality(**quality) if np.isfinite(list(quality.values())).all() else None


def _warn(scene: Scene, progress: Progress) -> None:
    tell(progress, (*scene.notes, *scene.warnings))


def _sphere_path(output: str | PathLike[str] | None, stem: str, *, has_levels: bool) -> Path:
    path = output_path(output, f"{stem}_spheres.json")
    check_sphere_extension(path)
    if has_levels and path.suffix.lower() != ".json":
        raise ArgumentError("levels", f"are kept by .json alone, not by {path}; rename it, or fit each level by itself")
    return path
