"""Spheres: from a mesh file to a set of spheres that stands in for it."""

from contextlib import nullcontext
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from aoprecalc.errors import InputError, UsageError
from aoprecalc.io import Outputs, load_scene, source_files
from aoprecalc.io.outputs import claim_output, output_path
from aoprecalc.io.sphere_files import (
    check_sphere_extension,
    quality_document,
    read_spheres,
    sphere_document,
    write_sphere_set,
)
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import Quality, fit_sphere_set, measure_quality
from aoprecalc.types import SphereSet


@dataclass(frozen=True, eq=False)
class SpheresResult:
    """Where the spheres were written, the spheres, what was measured about them, and all of it as JSON text."""

    path: Path
    spheres: SphereSet
    quality: Quality
    document: str


@dataclass(frozen=True, eq=False)
class MeasureResult:
    """What was measured about spheres, and the same as JSON text."""

    quality: Quality
    document: str


def fit_spheres(
    mesh: str | PathLike[str],
    output: str | PathLike[str] | None = None,
    *,
    outputs: Outputs | None = None,
    options: SphereOptions | None = None,
    progress: Progress | None = None,
) -> SpheresResult:
    """Fit spheres to a mesh file and write them.

    output   a file, or a folder (existing, or ending in /); by default <stem>_spheres.json in the current folder
    outputs  receives the file, which the caller then moves to its place; None: it appears at the end
    Raises InputError, UsageError or OutputError; then no file is left behind.
    """
    options, progress = options or SphereOptions(), progress or Progress()
    mesh = Path(mesh)
    path = output_path(output, f"{mesh.stem}_spheres.json")
    check_sphere_extension(path)
    if options.levels and path.suffix.lower() != ".json":
        raise UsageError(f"{path}: --levels are kept by .json alone; rename the output, or fit each level by itself")
    with Outputs() if outputs is None else nullcontext(outputs) as outputs:
        outputs.protect([mesh])
        claim_output(outputs, output, path)
        with progress.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        spheres, quality = fit_sphere_set(scene, options, progress)
        write_sphere_set(outputs.path(path), spheres, quality, scene)
    for line in scene.warnings:
        progress.warn(line)
    return SpheresResult(path, spheres, quality, sphere_document(spheres, quality))


def measure_spheres(
    mesh: str | PathLike[str],
    spheres: str | PathLike[str],
    *,
    options: SphereOptions | None = None,
    progress: Progress | None = None,
) -> MeasureResult:
    """Measure how well the spheres in a file (.json .csv .npz), of any origin, stand in for a mesh file.

    Of the options only `samples` and `seed` count. Raises InputError where either file cannot be used.
    """
    options, progress = options or SphereOptions(), progress or Progress()
    centers, radii = read_spheres(Path(spheres))
    with progress.stage("load"):
        scene = load_scene(Path(mesh))
    with np.errstate(over="ignore", invalid="ignore"):  # what comes of it is refused below
        quality = measure_quality(scene, centers, radii, options, progress)
    for line in scene.warnings:
        progress.warn(line)
    if not np.isfinite(list(quality.values())).all():
        raise InputError(
            f"{spheres}: its spheres are so far from {mesh} that nothing can be measured; do they belong to it?"
        )
    return MeasureResult(quality, quality_document(len(radii), quality))
