"""Assets of a batch, and the jobs that make them: what a worker does, wherever it runs."""

import os
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from aoprecalc.api.bake import bake_file
from aoprecalc.api.reports import BakeReport
from aoprecalc.api.spheres import fit_spheres_file
from aoprecalc.errors import AoprecalcError, KilledError, option_name, system_failure
from aoprecalc.io import Outputs
from aoprecalc.io.outputs import write_json
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.options.fields import option_files, with_files
from aoprecalc.progress import Progress
from aoprecalc.system import path_from
from aoprecalc.types import Float32Array
from aoprecalc.visibility.source import LocalVisibility, TexelRequest, VisibilityFactory


@dataclass(frozen=True)
class JobSpec:
    """What to make of one asset: a texture, a sphere set, or both.

    bake             options of the texture; None: no texture
    spheres          options of the sphere set; None: no spheres
    bake_output      file extensions as `aoprecalc bake -o` takes them: of an image, of a mesh, or both
    verify           measure the texture against ray tracing, for the report
    spheres_output   file extensions of the sphere set, each of which is written
    bent_normals, sh   file extensions of the pictures of bent normals and of spherical harmonics; empty: none
    """

    bake: BakeOptions | None = None
    spheres: SphereOptions | None = None
    bake_output: tuple[str, ...] = (".png",)
    verify: bool = False
    spheres_output: tuple[str, ...] = (".json",)
    bent_normals: str = ""
    sh: str = ""

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that its options name."""
        return () if self.bake is None else tuple(map(Path, option_files(self.bake)))

    def with_files(self, moved: Callable[[str], str]) -> "JobSpec":
        """Return the same spec with `moved(path)` for the path of each of these files."""
        return self if self.bake is None else replace(self, bake=with_files(self.bake, moved))

    def with_threads(self, threads: int) -> "JobSpec":
        """Return the same spec with this many threads, unless it has a number of threads already."""
        if self.bake is None or self.bake.threads:
            return self
        return replace(self, bake=replace(self.bake, threads=threads))


@dataclass(frozen=True)
class Asset:
    """One mesh of a batch.

    name    unique; the folder and stem of its files below the output folder, such as props/rock
    mesh    its file, as the pattern found it
    spec    what to make of it
    """

    name: str
    mesh: Path
    spec: JobSpec

    @property
    def folder(self) -> str:
        """The folder of its files below the output folder; empty: the output folder."""
        return self.name.rpartition("/")[0]

    @property
    def stem(self) -> str:
        """The beginning of its files' names."""
        return self.name.rpartition("/")[2]


FailureKind = Literal["error", "crash", "timeout", "stopped"]


@dataclass(frozen=True)
class Job:
    """The work on one asset.

    name        of the asset
    mesh        its file, absolute
    label       the mesh as messages and reports name it
    folder      where its files will be, absolute; they refer to each other and to the mesh from there
    stem        the beginning of their names
    staging     a folder of the same file system, in which they are written
    spec        what to make
    scheduler   address of the Dask scheduler whose workers share the visibility of its bake; None: no sharing
    files       the files that the options of the spec name, as the user wrote them, in the order of `JobSpec.files`
    """

    name: str
    mesh: Path
    label: str
    folder: Path
    stem: str
    staging: Path
    spec: JobSpec
    scheduler: str | None = None
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Success:
    """The results of a job.

    files     final name -> file in the staging folder
    summary   plain JSON values: `triangles`, `warnings`, and depending on the spec `ao_mean`, `directions`, `size`,
              `renderer`, `unwrap`, `rmse`, `spheres`, `silhouette_iou`
    seconds   including tries whose process died
    """

    files: dict[str, Path]
    summary: dict[str, Any]
    seconds: float = 0.0


@dataclass(frozen=True)
class Failure:
    """Why a job has no results.

    kind        error: bad input or options, or the work failed; crash: the process died; timeout; stopped: by the user
    message     one line
    exit_code   of the command that makes this asset alone
    details     a traceback, if it is a fault of aoprecalc
    seconds     including all tries
    """

    kind: FailureKind
    message: str
    exit_code: int = 1
    details: str = ""
    seconds: float = 0.0


Outcome = Success | Failure


@dataclass(frozen=True, eq=False)
class VisibilityTask:
    """Part of the visibility of a bake, for a worker of a cluster: some texels, one group of axes.

    label         of the job, for messages
    bake_id       of the bake; the same for all of its tasks
    inputs        the BakeInputs, pickled
    side          index into the sides of the BakeSetup
    request       which of its texels, which axes
    chunk_size    the most texels of any task of the bake
    shadow_size   width and height of a depth map in texels
    """

    label: str
    bake_id: str
    inputs: bytes
    side: int
    request: TexelRequest
    chunk_size: int
    shadow_size: int


@dataclass(frozen=True, eq=False)
class VisibilitySums:
    """The visibility sums of a task, (k, columns) float32, and the seconds that they took."""

    sums: Float32Array
    seconds: float = 0.0


class JobProgress(Progress):
    """Reports the stages of a job, and collects its warnings."""

    def __init__(self, on_stage: Callable[[str], None]) -> None:
        """Call `on_stage` with the name of each stage."""
        self._on_stage = on_stage
        self.warnings: list[str] = []

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Report a stage."""
        self._on_stage(name)
        yield

    def warn(self, text: str) -> None:
        """Collect a warning."""
        self.warnings.append(text)


def local_visibility(job: Job) -> AbstractContextManager[VisibilityFactory]:
    """Evaluate the visibility of a job in this process."""
    return nullcontext(LocalVisibility)


def run_job(
    job: Job,
    on_stage: Callable[[str], None],
    open_visibility: Callable[[Job], AbstractContextManager[VisibilityFactory]] = local_visibility,
) -> Outcome:
    """Make what a job asks for in its staging folder; if that fails, leave no files there.

    on_stage          called with the name of each stage that begins
    open_visibility   returns where the visibility of the job is evaluated, as a context manager
    """
    try:
        with open_visibility(job) as make_visibility:
            return _run(job, JobProgress(on_stage), make_visibility)
    except AoprecalcError as error:
        kind: FailureKind = "crash" if isinstance(error, KilledError) else "error"
        return Failure(kind, _as_written(job, error.worded(option_name)), error.exit_code)
    except MemoryError:
        return Failure("error", f"{job.label}: out of memory; use a smaller size or fewer --jobs")
    except OSError as error:
        reason = _as_written(job, system_failure(error, "check the disk"))
        return Failure("error", f"{job.label}: {reason}")
    except Exception as error:
        reason = _as_written(job, f"{type(error).__name__}: {error}")
        return Failure("error", f"{job.label}: {reason}; this is a fault of aoprecalc", details=traceback.format_exc())


def _run(job: Job, progress: JobProgress, make_visibility: VisibilityFactory) -> Success:
    spec, folder, summary = job.spec, job.folder, dict[str, Any]()
    job.staging.mkdir(parents=True, exist_ok=True)
    with Outputs(job.staging) as outputs:
        if spec.bake is not None:
            baked = bake_file(
                job.mesh,
                tuple(folder / f"{job.stem}_ao{suffix}" for suffix in spec.bake_output),
                stem=job.stem,
                bent_normals=folder / f"{job.stem}_bent{spec.bent_normals}" if spec.bent_normals else None,
                sh=folder / f"{job.stem}_sh{spec.sh}" if spec.sh else None,
                verify=spec.verify,
                outputs=outputs,
                make_visibility=make_visibility,
                options=spec.bake,
                progress=progress,
            )
            report = _with_relative_paths(job, baked.report)
            write_json(outputs.path(folder / f"{job.stem}_report.json"), report.to_dict())
            summary |= _summarise(report)
        if spec.spheres is not None:
            _, fitted = fit_spheres_file(
                job.mesh,
                tuple(folder / f"{job.stem}_spheres{suffix}" for suffix in spec.spheres_output),
                outputs=outputs,
                options=spec.spheres,
                progress=progress,
            )
            summary |= {
                "spheres": len(fitted),
                "silhouette_iou": round(fitted.quality.silhouette_iou, 4),
            }
        files = {final.name: staged for final, staged in outputs.release().items()}
    warnings = [_with_user_paths(job, job.mesh.name, line) for line in dict.fromkeys(progress.warnings)]
    return Success(files, {**summary, "warnings": warnings})


def _with_relative_paths(job: Job, report: BakeReport) -> BakeReport:
    """Return a report with paths relative to its own folder: it is the same wherever it was made."""
    outputs = report.outputs
    return replace(
        report,
        input=replace(report.input, path=path_from(job.mesh, job.folder)),
        options=with_files(report.options, lambda path: path_from(Path(path), job.folder)),
        outputs=replace(
            outputs,
            texture=None if outputs.texture is None else Path(outputs.texture).name,
            textures=tuple(Path(texture).name for texture in outputs.textures),
            mesh=Path(outputs.mesh or "").name,
            bent_normals=tuple(Path(picture).name for picture in outputs.bent_normals),
            sh=tuple(Path(picture).name for picture in outputs.sh),
            others=tuple(Path(other).name for other in outputs.others),
        ),
        warnings=tuple(_with_user_paths(job, job.mesh.name, line) for line in report.warnings),
        notes=tuple(_with_user_paths(job, job.mesh.name, line) for line in report.notes),
    )


def _summarise(report: BakeReport) -> dict[str, Any]:
    return {
        "triangles": report.input.triangles,
        "ao_mean": report.ao.mean,
        "directions": report.directions,
        "size": [report.texels.width, report.texels.height],
        "renderer": report.renderer,
        "unwrap": report.unwrap.method,
        "rmse": None if report.verify is None else report.verify.levels[0].rmse,
    }


def _as_written(job: Job, text: str) -> str:
    """Return an error of a job, on one line, with its mesh and the files of its options as the user wrote them."""
    for file, written in zip(job.spec.files, job.files, strict=True):
        text = text.replace(str(file), written)
    return _with_user_paths(job, job.label, text)


def _with_user_paths(job: Job, mesh_name: str, text: str) -> str:
    """Return a message, on one line, with the absolute paths of a job replaced by paths that the user knows.

    mesh_name   replaces the path of the mesh; files beside the mesh get its folder, outputs get none, and files that
                options name the path from the outputs
    """
    parent = os.path.dirname(mesh_name)
    beside = f"{parent}/" if parent else ""
    for file in job.spec.files:
        text = text.replace(str(file), path_from(file, job.folder))
    text = text.replace(f"{job.folder}/", "").replace(str(job.mesh), mesh_name).replace(f"{job.mesh.parent}/", beside)
    return " ".join(text.split())
