"""Which UVs a bake uses: those of the file if they can hold a bake, else new ones, made in a process of their own."""

import io
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Any, NoReturn, cast

import numpy as np

from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, KilledError, counted, one_or_many, option_name
from aoprecalc.mesh.surface import area_vectors, face_normals
from aoprecalc.mesh.topology import face_components
from aoprecalc.options import LARGE_MESH, BakeOptions, Unwrap
from aoprecalc.progress import Progress
from aoprecalc.raster.cpu_rasterizer import overlapping_triangles
from aoprecalc.raster.layout import (
    MAX_TILES,
    Layout,
    Rasterizer,
    atlas_from_uvs,
    build_layout,
    corner_ids,
    doubled_uv_areas,
)
from aoprecalc.subprocesses import (
    ChildKilledError,
    ChildTimeoutError,
    StepCallback,
    ask,
    command,
    end_with_parent,
    report_step,
)
from aoprecalc.types import Atlas, BoolArray, Float32Array, Float64Array, Int32Array, Scene, UvCheck
from aoprecalc.uv.charts import (
    FINER,
    Charts,
    Unwrapper,
    cut_again,
    make_charts,
    out_of_scale,
    sum_over_charts,
)
from aoprecalc.uv.pack import NoRoomError, pack_charts

RasterizerFactory = Callable[[Layout], Rasterizer]
# Measures an atlas coarsely: (h, w) int32, the face at each texel or -1, and (h, w) float32, its ambient occlusion.
FirstLook = Callable[[Atlas], tuple[Int32Array, Float32Array]]

MAX_OVERLAP = 0.001  # share of the covered texels inside two triangles, and of the surface without area in UV space
MIN_SIZE = 16  # texels
_TINY = 1e-4  # square texels that do not matter
_SCALES = 0.25, 2.5  # of charts by need
_PRIOR = 0.5  # pairs of texels of average difference, added to those of each chart
_NOISE = 0.006  # difference of neighbouring texels that does not matter
_CHILDREN = {method: command("aoprecalc.uv.unwrap", method) for method in ("xatlas", "uvunwrap")}
_OTHER = {"xatlas": "uvunwrap", "uvunwrap": "xatlas"}
_IF_SLOW = {"xatlas": "use --unwrap uvunwrap", "uvunwrap": "use a mesh of fewer faces"}


def choose_atlas(
    make_rasterizer: RasterizerFactory,
    scene: Scene,
    options: BakeOptions,
    progress: Progress,
    first_look: FirstLook | None = None,
) -> Atlas:
    """Keep the file's UVs if `options.unwrap` allows it and they can hold a bake, else unwrap.

    first_look   see `unwrap`
    Raises InputError where `keep` is asked for and impossible, UsageError where an unwrapper is asked for that is not
    installed, AoprecalcError where the unwrapper fails or takes longer than `unwrap_timeout`.
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
    size = min(options.width, options.height)

    def unwrap_with(method: Unwrapper) -> Atlas:
        timeout, on_step = options.unwrap_timeout, progress.step
        atlas = unwrap(scene, method, size, options.padding, first_look, timeout=timeout, on_step=on_step)
        return replace(atlas, checks=tuple(checks))

    try:
        return unwrap_with(methods[0])
    except KilledError:  # which says nothing about the mesh
        raise
    except AoprecalcError as error:
        if len(methods) == 1 or not isinstance(error.__cause__, ChildProcessError):
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


def check_uvs(
    make_rasterizer: RasterizerFactory, scene: Scene, uv_set: int, width: int, height: int
) -> tuple[UvCheck, Atlas | None]:
    """Check one of the file's UV sets, by index; also return its atlas, None where it has no area or repeats too much.

    It has no fault if the faces without area in UV space, by their share of the surface, and the texels that lie inside
    two triangles, wrapped modulo 1, by theirs of the covered ones, are less than MAX_OVERLAP together, and no face
    spans more than MAX_TILES repeats of the texture. Faces without area in UV space have no place in the atlas.
    """
    uvs, needed = scene.uv_sets[uv_set], needs_uvs(scene)
    longest = np.linalg.norm(np.roll(uvs, -1, axis=1) - uvs, axis=2).max(axis=1)
    without = needed & (doubled_uv_areas(uvs) <= 1e-9 * np.maximum(longest**2, 1e-9))
    mapped, flat, share = needed & ~without, int(np.count_nonzero(without)), surface_share(scene, without)
    no_area = f"{counted(flat, 'face')} with area {one_or_many(flat, 'has', 'have')} no area in UV space"
    check = UvCheck(uv_set, flat, share, 0, None, f"{no_area} ({share:.1%} of the surface)" if flat else "")
    if not mapped.any():
        return check, None
    check = replace(check, tiles=int(np.ceil(uvs[mapped].max(axis=1) - np.floor(uvs[mapped].min(axis=1))).max()))
    if check.tiles > MAX_TILES:
        fault = f"a face lies on {check.tiles} repeats of the texture; at most {MAX_TILES} may be"
        return replace(check, fault=fault), None
    atlas = replace(atlas_from_uvs(scene, uvs, mapped), uv_set=uv_set)
    overlap = make_rasterizer(build_layout(scene, atlas, width, height)).overlap()
    if share + overlap < MAX_OVERLAP:
        fault = ""
    elif overlap >= MAX_OVERLAP:
        fault = f"{overlap:.1%} of the texels lie inside two triangles; at most {MAX_OVERLAP:.1%} may"
    else:
        fault = check.fault
    return replace(check, overlap=overlap, fault=fault), atlas


def surface_share(scene: Scene, faces: BoolArray) -> float:
    """Return the share of the surface that needs UVs which some of its faces, (f,) bool, are."""
    areas = np.linalg.norm(area_vectors(scene.corners), axis=1)
    return float(areas[faces].sum() / areas[needs_uvs(scene)].sum())


def needs_uvs(scene: Scene) -> BoolArray:
    """Return the faces, (f,) bool, that need UVs of their own: those with area that receive and share no other's UVs.

    Raises InputError where there are none.
    """
    baked = scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)
    with_area: BoolArray = baked & face_normals(scene.corners)[1]
    if not with_area.any():
        raise InputError(
            f"{scene.path}: none of {counted(np.count_nonzero(baked), 'face')} has area; expected a surface to bake"
        )
    return with_area


# New UVs for a whole scene, packed into one page of the texture's size.


def unwrap(
    scene: Scene,
    method: Unwrapper,
    size: int,
    padding: int,
    first_look: FirstLook | None = None,
    *,
    timeout: float | None = None,
    on_step: StepCallback | None = None,
) -> Atlas:
    """Cut the scene into charts, flatten them and pack them for a texture whose shorter side is `size` texels.

    padding      texels around each chart that should stay free; see `pack.choose_gutter` for meshes without such room
    first_look   measures an atlas coarsely, so that charts get texels by need; None: all get as many per unit of length
    timeout      seconds that the unwrapper may take; None: any number
    on_step      is called several times a second with the step that the unwrapper is at
    Raises InputError where no face has area, UsageError where the size is too small for any chart, AoprecalcError where
    the unwrapper fails or times out. After any exception, Ctrl-C included, the unwrapper is gone.
    """
    if size < MIN_SIZE:
        raise ArgumentError("size", f"is {size}, which has no room for charts and gutters; use at least {MIN_SIZE}")
    mapped = needs_uvs(scene)
    # Both unwrappers compare lengths with constants: they are given a mesh about one unit across.
    used, corners = np.unique(scene.faces[mapped], return_inverse=True)
    positions = scene.positions[used] - scene.positions[used].min(axis=0)
    positions /= positions.max()
    faces = corners.reshape(-1, 3).astype(np.int32)
    try:
        uvs, placed, charts, gutter = _run(method, positions, faces, size, padding, timeout, on_step)
    except ChildTimeoutError as error:
        raise AoprecalcError(
            f"{method} has not unwrapped {counted(len(faces), 'face')} within {timeout:g} s (--unwrap-timeout), "
            f"it is at: {error.step}; allow more time or {_IF_SLOW[method]}"
        ) from error
    all_uvs: Float64Array = np.zeros((len(scene.faces), 3, 2))
    all_uvs[mapped] = uvs
    mapped[mapped] = placed
    return _fill_page(scene, Atlas(method, all_uvs, mapped, charts, gutter=gutter), first_look, size, padding)


def _run(
    method: Unwrapper,
    positions: Float64Array,
    faces: Int32Array,
    size: int,
    padding: int,
    timeout: float | None,
    on_step: StepCallback | None,
) -> tuple[Float64Array, BoolArray, int, int]:
    """Unwrap in a child process: UVs (f, 3, 2), placed (f,) bool, the number of charts and the gutter."""
    request = io.BytesIO()
    np.savez(request, positions=positions, faces=faces, size=size, padding=padding)
    try:
        answer = np.load(io.BytesIO(ask(_CHILDREN[method], request.getvalue(), on_step, timeout=timeout)))
    except ChildProcessError as error:
        message = f"{method} could not unwrap {counted(len(faces), 'face')}: {error}; or try --unwrap {_OTHER[method]}"
        raise (KilledError if isinstance(error, ChildKilledError) else AoprecalcError)(message) from error
    return answer["uvs"].astype(np.float64), answer["placed"], int(answer["charts"]), int(answer["gutter"])


def _fill_page(scene: Scene, atlas: Atlas, first_look: FirstLook | None, size: int, padding: int) -> Atlas:
    """Return a new atlas with its charts as large as the page has room for, in the scales that the first look tells.

    Charts that hold one value, as hidden ones do, are smaller. If neighbouring texels of a chart differ by d, its error
    is in proportion to d; charts of area A at t texels a unit take A t^2 texels, and leave a squared error of
    A (d / t)^2. The sum of the errors is least, for as many texels, where t is in proportion to the square root of d.
    """
    chart = face_components(corner_ids(scene.faces[atlas.mapped], atlas.uvs[atlas.mapped]))
    scales = np.ones(atlas.charts)
    if first_look is not None:
        faces, values = first_look(atlas)
        of_face: Int32Array = np.full(len(scene.faces) + 1, -1, np.int32)  # face -1 reads the last one
        of_face[:-1][atlas.mapped] = chart
        scales = scales_by_need(of_face[faces], values, atlas.charts)
    charts = Charts(atlas.uvs[atlas.mapped] * scales[chart, None, None], chart)  # they keep their shapes in the page
    try:
        packed = pack_charts(charts, size, padding)
    except NoRoomError:  # where the page has hardly a texel for each chart
        return atlas
    uvs = np.zeros_like(atlas.uvs)
    uvs[atlas.mapped] = packed.uvs
    return replace(atlas, uvs=uvs, gutter=packed.gutter)


def scales_by_need(charts: Int32Array, values: Float32Array, count: int) -> Float64Array:
    """Return the scales of `count` charts, (count,), from an image of charts, -1 for none, and one of their values."""
    squared, pairs = np.zeros(count), np.zeros(count)
    for one, other in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        same = (charts[one] == charts[other]) & (charts[one] >= 0)
        difference = values[one][same].astype(np.float64) - values[other][same]
        squared += np.bincount(charts[one][same], difference**2, count)
        pairs += np.bincount(charts[one][same], minlength=count)
    mean = squared.sum() / max(pairs.sum(), 1)
    differences = (squared + _PRIOR * mean) / (pairs + _PRIOR) + _NOISE**2
    scales: Float64Array = np.clip((differences / (mean + _NOISE**2)) ** 0.25, *_SCALES)
    return scales


# The child process, an end of `subprocesses.ask`. xatlas neither releases the interpreter nor can be interrupted, so
# the parent must be able to go on, or to end it. uvunwrap can be interrupted, but a fault inside it (an index out of
# bounds, on some meshes) ends one of its threads, and the job never finishes; the parent detects the panic message.


def cut_and_pack(
    method: Unwrapper, positions: Float64Array, faces: Int32Array, size: int, padding: int
) -> dict[str, Any]:
    """Cut into charts, flatten them, and pack them into one page of size x size texels, which they need not fill.

    Charts that are faulty when they are packed, whoever cut and packed them, are cut into smaller ones.
    """
    charts = make_charts(method, positions, faces)
    report_step("packing")
    packed = pack_charts(charts, size, padding, quick=True)
    surface = np.linalg.norm(area_vectors(positions[faces]), axis=1) / 2
    for fineness in FINER:
        faulty = faulty_charts(packed.uvs, charts.chart, surface, size)
        if not faulty.any():
            break
        report_step(f"cutting {counted(np.count_nonzero(faulty), 'chart')} again")
        charts = cut_again(charts, faulty, method, positions, faces, fineness)
        packed = pack_charts(charts, size, padding, quick=True)
    return {"uvs": packed.uvs, "placed": charts.placed, "charts": charts.count, "gutter": packed.gutter}


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

    request: positions (v, 3) float64 about one unit across, faces (f, 3) int32, size and padding in texels
    answer:  uvs (f, 3, 2) float64 in [0, 1], placed (f,) bool: faces that got UVs, charts, gutter
    """
    end_with_parent()
    request = np.load(io.BytesIO(sys.stdin.buffer.read()))
    settings = int(request["size"]), int(request["padding"])
    try:
        answer = cut_and_pack(cast(Unwrapper, method), request["positions"], request["faces"], *settings)
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
