"""What a batch works on: an asset, and what is to be made of it."""

import os
import traceback
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from aoprecalc.api.bake import bake_file
from aoprecalc.api.reports import BakeOutputs, BakeReport
from aoprecalc.api.spheres import fit_spheres_file
from aoprecalc.errors import AoprecalcError, KilledError
from aoprecalc.io import Outputs
from aoprecalc.io.outputs import write_json
from aoprecalc.options import BakeOptions, SphereOptions
from aoprecalc.progress import Progress
from aoprecalc.types import Float32Array
from aoprecalc.visibility.gather import LocalVisibility, VisibilityFactory


@dataclass(frozen=True)
class JobSpec:
    """What is made of one asset: a texture, spheres, or both.

    bake      how the texture is baked; None: no texture
    spheres   how spheres are fitted; None: none
    texture   extension of the texture
    mesh      extension of the mesh that goes with it; empty: as `aoprecalc bake` chooses
    verify    measure the texture against ray tracing, for the report
    set       extension of the sphere set
    """

    bake: BakeOptions | None = None
    spheres: SphereOptions | None = None
    texture_suffix: str = ".png"
    mesh_suffix: str = ""
    verify: bool = False
    spheres_suffix: str = ".json"

    def with_threads(self, threads: int) -> "JobSpec":
        """Return the same with this many threads where it says nothing about them."""
        if self.bake is None or self.bake.threads:
            return self
        return replace(self, bake=replace(self.bake, threads=threads))


@dataclass(frozen=True)
class Asset:
    """One mesh of a batch.

    name    its folder and stem below the output folder, such as props/rock, with forward slashes; no other's
    mesh    its file, as the pattern found it
    spec    what is made of it
    """

    name: str
    mesh: Path
    spec: JobSpec

    @property
    def folder(self) -> str:
        """Its folder below the output folder; empty for that itself."""
        return self.name.rpartition("/")[0]

    @property
    def stem(self) -> str:
        """What its files' names begin with."""
        return self.name.rpartition("/")[2]


# The work on one asset: what a worker does, wherever it runs.

FailureKind = Literal["error", "crash", "timeout", "stopped"]


@dataclass(frozen=True)
class Job:
    """The work on one asset.

    name      of the asset
    mesh      its file, absolute
    label     the same as messages and reports call it
    folder    where its files are to go, absolute, and their names begin with `stem`
    staging   where they are written, of the same file system
    spec      what is made
    scheduler   address of the Dask scheduler whose workers evaluate its visibility; None: its own process does
    """

    name: str
    mesh: Path
    label: str
    folder: Path
    stem: str
    staging: Path
    spec: JobSpec
    scheduler: str | None = None


@dataclass(frozen=True)
class Success:
    """What came of it.

    files     name in the asset's folder -> where it was written
    summary   plain JSON values: `triangles`, `warnings`, and of what was made `ao_mean`, `directions`,
              `size`, `renderer`, `rmse`, `spheres`, `silhouette_iou`
    seconds   that it took, tries that died included
    """

    files: dict[str, Path]
    summary: dict[str, Any]
    seconds: float = 0.0


@dataclass(frozen=True)
class Failure:
    """Why nothing came of it.

    kind       error: it was refused, or the work failed; crash: its process died; timeout; stopped: by the user
    message    one line
    exit_code  that the command for this asset alone would have had
    details    a traceback, where it is a fault of aoprecalc
    seconds    that it took
    """

    kind: FailureKind
    message: str
    exit_code: int = 1
    details: str = ""
    seconds: float = 0.0


Outcome = Success | Failure


@dataclass(frozen=True, eq=False)
class VisibilityTask:
    """Part of the visibility of a bake, for a worker of a cluster: one chunk of texels, one group of axes.

    label         of the job, for messages
    bake_id       of the bake; the same for all of its tasks
    inputs        the BakeInputs, pickled
    side, group   indices into the sides and the groups of axes of the BakeSetup
    start, stop   the chunk, a range of the side's texels
    chunk_size    texels of the longest chunk of any task of the bake
    shadow_size   width and height of a depth map in texels
    """

    label: str
    bake_id: str
    inputs: bytes
    side: int
    group: int
    start: int
    stop: int
    chunk_size: int
    shadow_size: int


@dataclass(frozen=True, eq=False)
class VisibilitySums:
    """The visibility sums of a task, (stop - start, 2) float32, and the seconds that they took."""

    sums: Float32Array
    seconds: float = 0.0


class JobProgress(Progress):
    """Tells which stage a job is at, and keeps its warnings."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        """Call `tell` with each stage."""
        self._tell = tell
        self.warnings: list[str] = []

    @contextmanager
    def stage(self, name: str, total: int | None = None, unit: str = "") -> Iterator[None]:
        """Tell the stage."""
        self._tell(name)
        yield

    def warn(self, text: str) -> None:
        """Keep a warning."""
        self.warnings.append(text)


def local_visibility(job: Job) -> AbstractContextManager[VisibilityFactory]:
    """Have a job's process look by itself."""
    return nullcontext(LocalVisibility)


def run_job(
    job: Job,
    tell: Callable[[str], None],
    sight_of: Callable[[Job], AbstractContextManager[VisibilityFactory]] = local_visibility,
) -> Outcome:
    """Make what is asked for in the staging folder, and tell each stage; nothing is left there if it fails.

    sight_of   returns, for the length of a `with` block, what makes that which sees
    """
    try:
        with sight_of(job) as make_visibility:
            return _make(job, JobProgress(tell), make_visibility)
    except AoprecalcError as error:
        kind: FailureKind = "crash" if isinstance(error, KilledError) else "error"
        return Failure(kind, _shown(job, str(error)), error.exit_code)
    except MemoryError:
        return Failure("error", f"{job.label}: out of memory; use a smaller size or fewer --jobs")
    except OSError as error:
        return Failure("error", f"{job.label}: reading or writing failed ({_shown(job, str(error))}); check the disk")
    except Exception as error:
        said = _shown(job, f"{type(error).__name__}: {error}")
        return Failure("error", f"{job.label}: {said}; this is a fault of aoprecalc", details=traceback.format_exc())


def _make(job: Job, heard: JobProgress, make_visibility: VisibilityFactory) -> Success:
    spec, folder, summary = job.spec, job.folder, dict[str, Any]()
    job.staging.mkdir(parents=True, exist_ok=True)
    with Outputs(job.staging) as outputs:
        if spec.bake is not None:
            baked = bake_file(
                job.mesh,
                folder / f"{job.stem}_ao{spec.texture_suffix}",
                mesh_output=folder / f"{job.stem}_ao{spec.mesh_suffix}" if spec.mesh_suffix else None,
                stem=job.stem,
                verify=spec.verify,
                outputs=outputs,
                make_visibility=make_visibility,
                options=spec.bake,
                progress=heard,
            )
            report = _with_relative_paths(job, baked.report)
            write_json(outputs.path(folder / f"{job.stem}_report.json"), report.to_dict())
            summary |= _summarise(report)
        if spec.spheres is not None:
            _, fitted = fit_spheres_file(
                job.mesh,
                folder / f"{job.stem}_spheres{spec.spheres_suffix}",
                outputs=outputs,
                options=spec.spheres,
                progress=heard,
            )
            summary |= {
                "spheres": len(fitted),
                "silhouette_iou": round(fitted.quality.silhouette_iou, 4),
            }
        files = {place.name: written for place, written in outputs.release().items()}
    lines = [_called(job.mesh.name, job, line) for line in dict.fromkeys(heard.warnings)]
    return Success(files, {**summary, "warnings": lines})


def _with_relative_paths(job: Job, report: BakeReport) -> BakeReport:
    """Return a report with paths relative to its own folder: it is the same wherever it was made."""
    outputs = report.outputs
    return replace(
        report,
        input=replace(report.input, path=Path(os.path.relpath(job.mesh, job.folder)).as_posix()),
        outputs=BakeOutputs(
            texture=Path(outputs.texture or "").name,
            mesh=Path(outputs.mesh or "").name,
            others=tuple(Path(other).name for other in outputs.others),
        ),
        warnings=tuple(_called(job.mesh.name, job, line) for line in report.warnings),
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


def _shown(job: Job, text: str) -> str:
    """Return a message with the paths that the user knows."""
    return _called(job.label, job, text)


def _called(name: str, job: Job, text: str) -> str:
    """Return a message with another name for the mesh, one alike for what lies beside it, and no folder for results."""
    parent = os.path.dirname(name)
    beside = f"{parent}/" if parent else ""
    plain = text.replace(f"{job.folder}/", "").replace(str(job.mesh), name).replace(f"{job.mesh.parent}/", beside)
    return " ".join(plain.split())
