"""Spheres: from a mesh file to a set of spheres that stands in for it."""

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from aoprecalc.files import Outputs, load_scene, source_files
from aoprecalc.files.places import claim, output_place
from aoprecalc.files.sphere_sets import check_kind, write_sphere_set
from aoprecalc.model import SphereSet
from aoprecalc.options import SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.spheres import Quality, fit


@dataclass(frozen=True, eq=False)
class SpheresResult:
    """Where the spheres were written, the spheres, and what was measured about them."""

    path: Path
    spheres: SphereSet
    quality: Quality


def fit_spheres(
    mesh: str | PathLike[str],
    output: str | PathLike[str] | None = None,
    *,
    options: SphereOptions | None = None,
    progress: Progress | None = None,
) -> SpheresResult:
    """Fit spheres to a mesh file and write them.

    output   a file, or a folder (existing, or ending in /); by default <stem>_spheres.json in the current folder
    Raises InputError, UsageError or OutputError; then no file is left behind.
    """
    options, progress = options or SphereOptions(), progress or Progress()
    mesh = Path(mesh)
    path = output_place(output, f"{mesh.stem}_spheres.json")
    check_kind(path)
    with Outputs() as outputs:
        outputs.protect([mesh])
        claim(outputs, output, path)
        with progress.stage("load"):
            scene = load_scene(mesh)
        outputs.protect(source_files(scene))
        spheres, quality = fit(scene, options, progress)
        write_sphere_set(outputs.path(path), spheres, quality)
    for line in scene.warnings:
        progress.warn(line)
    return SpheresResult(path, spheres, quality)
