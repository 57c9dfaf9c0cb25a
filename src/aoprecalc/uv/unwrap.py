"""Which UVs a bake uses: those of the file if they can hold a bake, else new ones, made in a process of their own."""

import io
import os
import sys
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import Any, NoReturn, cast

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, KilledError, counted, option_name
from aoprecalc.mesh.surface import area_vectors
from aoprecalc.options import LARGE_MESH, BakeOptions, Unwrap
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import overlapping_triangles
from aoprecalc.raster.layout import doubled_uv_areas
from aoprecalc.subprocesses import (
    ChildKilledError,
    ChildTimeoutError,
    StepCallback,
    Watch,
    ask,
    command,
    end_with_parent,
    report_step,
)
from aoprecalc.types import Atlas, BoolArray, Float64Array, Int32Array, Scene, UvCheck
from aoprecalc.uv.charts import FINER, Charts, Unwrapper, cut_again, make_charts, out_of_scale, sum_over_charts
from aoprecalc.uv.checks import RasterizerFactory, check_uvs, needs_uvs
from aoprecalc.uv.fill import FirstLook, PageSpec, fill_page
from aoprecalc.uv.pack import NoRoomError, pack_charts

Cuts = dict[str, Charts]  # what unwrappers cut, by their names, before it was packed for any size

MIN_SIZE = 16  # texels
_TINY = 1e-4  # square texels that do not matter
_CHILDREN = {method: command("aoprecalc.uv.unwrap", method) for method in ("xatlas", "uvunwrap")}
_OTHER = {"xatlas": "uvunwrap", "uvunwrap": "xatlas"}
_IF_SLOW = {"xatlas": "use --unwrap uvunwrap", "uvunwrap": "use a mesh of fewer faces"}


def choose_atlas(
    make_rasterizer: RasterizerFactory,
    scene: Scene,
    options: BakeOptions,
    progress: Progress,
    first_look: FirstLook | None = None,
    cuts: Cuts | None = None,
) -> Atlas:
    """Keep the file's UVs if `options.unwrap` allows it and they can hold a bake, else unwrap.

    first_look, cuts   see `unwrap`
    Raises InputError where `keep` is asked for and impossible, UsageError where an unwrapper is asked for that is not
    installed, AoprecalcError where the unwrapper fails or takes longer than `unwrap_timeout`; see also `unwrap`.
    """
    checks: list[UvCheck] = []
    if options.unwrap in ("auto", "keep"):
        able: list[Atlas | None] = []
        for uv_set in range(len(scene.uv_sets)):
            check, atlas = check_uvs(make_rasterizer, scene, uv_set, options.width, options.height)
            checks.append(check)
            able.append(atlas)
            if not check.fault:
                break
        kept = _kept_set(checks, able, options.unwrap)
        if kept is not None:
            return replace(kept, checks=tuple(checks))
        faults = "; ".join(f"set {check.uv_set}: {check.fault}" for check in checks) or "it has none"
        if len(checks) == 1:
            faults = checks[0].fault
        if options.unwrap == "keep":
            raise InputError(f"{scene.path}: its UVs cannot hold a bake ({faults}); use --unwrap auto or xatlas")
        progress.note(f"the file's UVs are not kept: {faults}" if checks else "the file has no UVs")
    methods = _choose_unwrappers(options.unwrap, int(np.count_nonzero(needs_uvs(scene))), progress)
    page = PageSpec(min(options.width, options.height), options.padding, options.texel_density)

    def unwrap_with(method: Unwrapper) -> Atlas:
        timeout, on_step = options.unwrap_timeout, progress.step
        atlas = unwrap(scene, method, page, first_look, cuts=cuts, timeout=timeout, on_step=on_step)
        return replace(atlas, checks=tuple(checks))

    try:
        return unwrap_with(methods[0])
    except KilledError:  # which says nothing about the mesh
        raise
    except AoprecalcError as error:
        if len(methods) == 1 or not isinstance(error.__cause__, ChildProcessError | NoRoomError):
            raise
        progress.note(f"{methods[1]} is used instead: {error.worded(option_name)}")
        return unwrap_with(methods[1])


def _choose_unwrappers(wanted: Unwrap, faces: int, progress: Progress) -> list[Unwrapper]:
    """Return the unwrapper to use, and what to use if that fails by a fault of its own.

    Raises UsageError where the one that is asked for is not installed, or none is.
    """
    names: tuple[Unwrapper, ...] = ("xatlas", "uvunwrap")
    installed = [name for name in names if find_spec(name) is not None]
    if wanted == "xatlas" or wanted == "uvunwrap":
        if wanted in installed:
            return [wanted]
        other = "uvunwrap" if wanted == "xatlas" else "xatlas"
        raise ArgumentError("unwrap", f"is {wanted}, which is not installed; `pip install {wanted}`, or use {other}")
    if not installed:
        raise ArgumentError("unwrap", "needs xatlas or uvunwrap, neither of which is installed; `pip install uvunwrap`")
    if installed == ["uvunwrap"]:
        progress.note("uvunwrap makes the UVs: xatlas is not installed (PyPI has none for Python 3.14 or Linux on ARM)")
        return installed
    return installed[::-1] if faces > LARGE_MESH else installed[:1]


def _kept_set(checks: list[UvCheck], atlases: list[Atlas | None], wanted: Unwrap) -> Atlas | None:
    """Return the atlas of the set to keep: one without a fault, or for `keep` that which loses least; None for none."""
    lost = {
        uv_set: check.flat_share + (check.overlap or 0.0)
        for uv_set, (check, atlas) in enumerate(zip(checks, atlases, strict=True))
        if atlas is not None and (wanted == "keep" or not check.fault)
    }
    return atlases[min(lost, key=lambda uv_set: (bool(checks[uv_set].fault), lost[uv_set]))] if lost else None


# New UVs for a whole scene, packed into one page of the texture's size.


def unwrap(
    scene: Scene,
    method: Unwrapper,
    page: PageSpec,
    first_look: FirstLook | None = None,
    *,
    cuts: Cuts | None = None,
    timeout: float | None = None,
    on_step: StepCallback | None = None,
) -> Atlas:
    """Cut the scene into charts, flatten them and pack them into a page, the shorter side of the texture.

    first_look   measures an atlas coarsely, so that charts get texels by need; None: all get as many per unit of length
    cuts         of this scene, by earlier calls; receives that of this one
    timeout      seconds that this may take; None: any number
    on_step      is called several times a second with the step that the work is at; may raise to end it
    Raises InputError where no face has area, UsageError where the size is too small for any chart, TooDenseError where
    it is for the density of the page, AoprecalcError where the unwrapper fails or times out. After any exception,
    Ctrl-C included, the unwrapper is gone.
    """
    if page.size < MIN_SIZE:
        raise ArgumentError(
            "size", f"is {page.size}, which has no room for charts and gutters; use at least {MIN_SIZE}"
        )
    mapped = needs_uvs(scene)
    # Both unwrappers compare lengths with constants: they are given a mesh about one unit across.
    used, corners = np.unique(scene.faces[mapped], return_inverse=True)
    positions = scene.positions[used] - scene.positions[used].min(axis=0)
    positions /= positions.max()
    faces = corners.reshape(-1, 3).astype(np.int32)
    watch = Watch(on_step, timeout)
    try:
        whole = None if scene.polygons is None else scene.polygons[mapped]
        answer = _run(method, positions, faces, whole, page, {} if cuts is None else cuts, timeout, on_step)
        all_uvs: Float64Array = np.zeros((len(scene.faces), 3, 2))
        all_uvs[mapped] = answer["uvs"]
        mapped[mapped] = answer["placed"]
        atlas = Atlas(method, all_uvs, mapped, int(answer["charts"]), gutter=int(answer["gutter"]))
        return fill_page(scene, atlas, page, first_look, partial(watch, "packing"))
    except ChildTimeoutError as error:
        raise AoprecalcError(
            f"{method} has not unwrapped {counted(len(faces), 'face')} within {timeout:g} s (--unwrap-timeout), "
            f"it is at: {error.step}; allow more time or {_IF_SLOW[method]}"
        ) from error


def _run(
    method: Unwrapper,
    positions: Float64Array,
    faces: Int32Array,
    polygons: Int32Array | None,
    page: PageSpec,
    cuts: Cuts,
    timeout: float | None,
    on_step: StepCallback | None,
) -> dict[str, Any]:
    """Unwrap in a child process; see `main` for its answer."""
    request = io.BytesIO()
    arrays: dict[str, Any] = {"positions": positions, "faces": faces, "size": page.size, "padding": page.padding}
    if polygons is not None:
        arrays["polygons"] = polygons
    if method in cuts:
        arrays |= {"cut_uvs": cuts[method].uvs, "cut_chart": cuts[method].chart}
    np.savez(request, **arrays)
    try:
        answer = dict(np.load(io.BytesIO(ask(_CHILDREN[method], request.getvalue(), on_step, timeout=timeout))))
    except ChildProcessError as error:
        message = f"{method} could not unwrap {counted(len(faces), 'face')}: {error}; or try --unwrap {_OTHER[method]}"
        raise (KilledError if isinstance(error, ChildKilledError) else AoprecalcError)(message) from error
    cuts[method] = Charts(answer.pop("cut_uvs"), answer.pop("cut_chart"))
    if "no_room" in answer:
        no_room = NoRoomError(str(answer["no_room"]))
        raise ArgumentError("size", f"is {page.size}, but {no_room}; use a larger one") from no_room
    return answer


# The child process, an end of `subprocesses.ask`. xatlas neither releases the interpreter nor can be interrupted, so
# the parent must be able to go on, or to end it. uvunwrap can be interrupted, but a fault inside it (an index out of
# bounds, on some meshes) ends one of its threads, and the job never finishes; the parent detects the panic message.


def cut_and_pack(
    method: Unwrapper,
    positions: Float64Array,
    faces: Int32Array,
    size: int,
    padding: int,
    cut: Charts | None = None,
    polygons: Int32Array | None = None,
) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into one page of size x size texels, which they need not fill.

    Charts that are faulty when they are packed, whoever cut and packed them, are cut into smaller ones.
    cut        what `make_charts` gave before; None: it is called
    polygons   see `make_charts`
    """
    charts = cut = cut or make_charts(method, positions, faces, polygons=polygons)
    answer = {"cut_uvs": cut.uvs, "cut_chart": cut.chart}
    report_step("packing")
    surface = np.linalg.norm(area_vectors(positions[faces]), axis=1) / 2
    try:
        packed = pack_charts(charts, size, padding, quick=True)
        for fineness in FINER:
            faulty = faulty_charts(packed.uvs, charts.chart, surface, size)
            if not faulty.any():
                break
            report_step(f"cutting {counted(np.count_nonzero(faulty), 'chart')} again")
            charts = cut_again(charts, faulty, method, positions, faces, fineness, polygons)
            packed = pack_charts(charts, size, padding, quick=True)
    except NoRoomError as error:
        return answer | {"no_room": str(error)}
    return answer | {"uvs": packed.uvs, "placed": charts.placed, "charts": charts.count, "gutter": packed.gutter}


def faulty_charts(uvs: Float64Array, chart: Int32Array, surface: Float64Array, size: int) -> BoolArray:
    """Return which charts are blown up or shrunk, fold, or lie over others, (n,) bool.

    uvs       (f, 3, 2) in [0, 1]
    chart     (f,) the chart of each face, -1 for none
    surface   (f,) the area of each face
    A chart's share of the texture must be that of the surface within a factor of MAX_RATIO, but for charts far smaller
    than a texel, and no texel's centre may lie inside two faces.
    """
    texels = sum_over_charts(chart, doubled_uv_areas(uvs) / 2 * size**2)
    faulty = out_of_scale(texels, sum_over_charts(chart, surface), _TINY)
    triangles = (uvs * (size, -size) + (0.0, size)).astype(np.float32)
    placed = chart >= 0
    faulty[chart[placed][overlapping_triangles(triangles[placed], size, size)]] = True
    return faulty


def main(method: str) -> NoReturn:
    """Answer one request: `python -m aoprecalc.uv.unwrap METHOD < request.npz > answer.npz`.

    request: positions (v, 3) float64 about one unit across, faces (f, 3) int32, size and padding in texels; perhaps
             polygons (f,) int32, and cut_uvs and cut_chart of an earlier answer
    answer:  uvs (f, 3, 2) float64 in [0, 1], placed (f,) bool: faces that got UVs, charts, gutter; or no_room, a text;
             cut_uvs and cut_chart: the `Charts` that were packed first
    """
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    settings = int(request["size"]), int(request["padding"])
    cut = Charts(request["cut_uvs"], request["cut_chart"]) if "cut_uvs" in request else None
    polygons = request.get("polygons")
    try:
        answer = cut_and_pack(cast(Unwrapper, method), request["positions"], request["faces"], *settings, cut, polygons)
    except ValueError as error:
        _exit(1, str(error))
    except MemoryError:
        _exit(1, "out of memory; use a mesh of fewer faces")
    buffer = io.BytesIO()
    np.savez(buffer, **answer)
    sys.stdout.buffer.write(buffer.getvalue())
    _exit(0, "")


def _exit(status: int, message: str) -> NoReturn:
    """End the process without running destructors, see `charts.new_xatlas`."""
    sys.stderr.write(message)
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main(sys.argv[1])
