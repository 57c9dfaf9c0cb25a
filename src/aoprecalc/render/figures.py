"""The figures of *Précalcul* for a mesh.

Its depth map along one direction (1.1), that direction in texture space (1.2), the finished texture (1.3), the mesh
rendered with it (1.4); and samples of its surface, the spheres that are fitted to them, and their shadows (1.5).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from aoprecalc.errors import counted
from aoprecalc.mesh.detail import detail_of
from aoprecalc.mesh.opaque_triangles import opaque_triangles
from aoprecalc.mesh.roles import in_poses
from aoprecalc.mesh.surface import bounding_sphere, positions_of
from aoprecalc.options import BakeOptions, PreviewOptions
from aoprecalc.progress import Progress
from aoprecalc.raster.padding import pad_and_fill
from aoprecalc.raster.resolve import ResolvedTexture, lighter_of_sides
from aoprecalc.render.comparison import PAGE, Ticks, contact_sheet, fit_picture, grey_picture, with_scale
from aoprecalc.render.preview import REACH, Panel, Stage, open_stage
from aoprecalc.types import Baked, Float64Array, Picture, SphereSet, Texture, TexturedMesh
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.directions import MAX_SHADOW_SIZE, upright_projection
from aoprecalc.visibility.plan import FIT_CHUNK
from aoprecalc.visibility.setup import BakeInputs, BakeSetup
from aoprecalc.visibility.source import gather_one_direction

BACKGROUND = (66, 98, 146)  # of depth maps: no grey
_NEAREST, _FARTHEST = 0.94, 0.10  # their greys
_RAY_SIZE = 1024  # pixels a side of depth maps where the bake has none
_MARGIN = 0.04  # of a depth map's side that stays empty at each side
_CELL = 640  # pixels a side of the pictures in a sheet
_DOT = (24, 62, 118)  # sRGB
_DOTS_SHARE = 0.2  # of the mesh's pixels that dots cover
_MIN_DOT, _MAX_DOT = 0.1, 2.5  # their radius, in pixels
_REACH = 3  # pixels from its middle that a dot may cover
_DEPTH_PIXELS = 1.5  # how far a point may lie behind the surface nearest in its pixel, in pixels
_METHODS = {
    "lloyd": "Centred at the means of their samples",
    "algebraic": "Least-squares spheres of their samples",
    "shadow": "Fitted to the silhouettes of the mesh",
    "collision": "Together they hold the whole surface",
}
_FILLED = {"mean": "hold the mean", "pushpull": "are filled smoothly", "none": "are 0"}


@dataclass(frozen=True, eq=False)
class Figure:
    """One figure.

    name      its number, such as 1_2, and what else files are called by
    picture   (height, width, 3) uint8 sRGB, row 0 on top
    caption   a heading and, after a line break, an explanation
    scale     colours from left to right and their ticks, for the sheet; None where there is none
    """

    name: str
    picture: Picture
    caption: str
    scale: tuple[Picture, Ticks] | None = None


@dataclass(frozen=True, eq=False)
class DirectionPass:
    """What a bake measures along one direction.

    direction    (3,) float64: the unit vector w towards the light, in the mesh's coordinates
    depths       (2, s, s) float64: the greatest and the least p.w of the points p of the occluding surface at the
                 centre of each pixel, in the mesh's units; NaN where there is none; an upright view, row 0 on top
    pixel        the side of a pixel, in the mesh's units
    visibility   max(0, n.w) where the surface sees the light, else 0; padded and filled as the bake's texture is
    """

    direction: Float64Array
    depths: Float64Array
    pixel: float
    visibility: Texture


def trace_direction(baked: Baked, options: BakeOptions, direction: Float64Array, up: Float64Array) -> DirectionPass:
    """Measure one direction with the backend, the maps and the samples of a bake.

    options     of the bake
    direction   (3,) float64, a unit vector towards the light
    up          (3,) float64, a unit vector: towards the top of the depth maps

    Raises what `bake_scene` raises.
    """
    size = min(baked.shadow_size or options.shadow_size or _RAY_SIZE, MAX_SHADOW_SIZE)
    detail = detail_of(baked.scene)
    scene = in_poses(baked.scene, baked.normals)[0][0] if detail is None else detail.scene
    shown = positions_of(scene, scene.receives | scene.occludes)
    center, radius = bounding_sphere(shown)
    corners = opaque_triangles(scene)
    points, occluders = (
        ((positions - center) / radius).astype(np.float32)
        for positions in (shown, corners if len(corners) else np.tile(center, (1, 3, 1)))
    )
    with open_backend(options, Progress()) as backend:
        sized = replace(options, size=baked.texture.values.shape[::-1])
        setup = BakeSetup(backend, BakeInputs(baked.scene, baked.atlas, baked.normals, sized))
        projection = upright_projection(direction, up, points.astype(np.float64), size, _MARGIN)
        depths = backend.depths(occluders, projection, size)[:, ::-1]
        sides: list[ResolvedTexture] = []
        for side in setup.sides:
            chunk = max(1, min(FIT_CHUNK, len(side.texels)))
            integrand = replace(setup.integrand, sky=None)
            tester = backend.tester(side.surface, integrand, chunk, baked.shadow_size or size, len(side.texels))
            sides.append(gather_one_direction(setup, side, tester, direction, chunk))
        backend.check_errors()
    lighter = reduce(lighter_of_sides, sides)
    visibility = pad_and_fill(lighter, options.padding, options.fill, repeats=baked.atlas.repeats)
    in_units = depths.astype(np.float64) * radius + center @ direction
    return DirectionPass(direction, in_units, float(projection.pitch[0, 0]) * radius, visibility)


def bake_figures(
    baked: Baked, options: BakeOptions, traced: DirectionPass, clay: Picture, rendered: Picture
) -> tuple[Figure, ...]:
    """Draw figures 1.1 to 1.4; the last are given: the mesh rendered without its texture, and with it."""
    texture, (height, width) = baked.texture.values, baked.texture.values.shape
    nearest = float(np.nanmax(traced.depths)) if np.isfinite(traced.depths).any() else 0.0
    (near, near_scale), (far, far_scale) = (_depth_figure(depths, nearest) for depths in traced.depths)
    along = f"w = ({', '.join(f'{number:.3f}' for number in traced.direction)})"
    count = traced.depths.shape[1]
    padding = counted(options.padding, "texel")
    summed = (
        f"The visible share of {baked.directions} directions, weighted by the cosine"
        if options.estimator == "ratio"
        else f"4/N times the sum over N = {baked.directions} directions, at most 1"
    )
    return (
        Figure(
            "1_1_near",
            near,
            f"Figure 1.1, near: the depth map of one direction\nThe surface nearest to the light along {along}: "
            f"distance from its nearest point, in the mesh's units. {count} x {count} map texels.",
            near_scale,
        ),
        Figure(
            "1_1_far",
            far,
            "Figure 1.1, far: the map of the opposite direction\nThe surface farthest from the light, drawn in the "
            "same pass and seen from the same side, with distances from the same point.",
            far_scale,
        ),
        Figure(
            "1_2",
            grey_picture(traced.visibility.values),
            "Figure 1.2: that direction in texture space\nmax(0, n.w) where the surface sees the light, else 0. "
            f"{width} x {height} texels; charts are extended by {padding}, the texels beyond {_FILLED[options.fill]}.",
            _unit_scale("unlit", "lit straight on"),
        ),
        Figure(
            "1_3",
            grey_picture(texture),
            f"Figure 1.3: the finished texture\n{summed}. {width} x {height} texels.",
            _unit_scale("closed", "open"),
        ),
        Figure(
            "1_4_without",
            clay,
            "Figure 1.4, without: the mesh in even light\nThe light from all sides is the same everywhere.",
        ),
        Figure(
            "1_4",
            rendered,
            "Figure 1.4: the mesh rendered with it\nThe light from all sides is less where the texture is darker.",
        ),
    )


@dataclass(frozen=True, eq=False)
class FittedSpheres:
    """Spheres to show, and what is said of them.

    spheres          the spheres
    silhouette_iou   see `sphere_quality`
    surface_error    the mean, over the mesh's diagonal
    """

    spheres: SphereSet
    silhouette_iou: float
    surface_error: float


def sphere_figures(
    mesh: TexturedMesh,
    samples: Float64Array,
    fitted: Sequence[FittedSpheres],
    options: PreviewOptions,
    progress: Progress,
) -> tuple[Figure, ...]:
    """Draw figure 1.5: samples, (s, 3) in the mesh's coordinates, the mesh and sphere sets, each with its own shadow.

    All are drawn by one camera and one light.
    """
    sets = [(entry.spheres.centers, entry.spheres.radii) for entry in fitted]
    with open_stage(mesh, sets, options.width, options, progress) as stage:
        drawn = stage.draw(Panel())
        dotted = _draw_points(drawn, stage, samples)
        beyond = stage.beyond
        balls = [stage.draw(Panel(mesh=False, spheres=number, shadow_of=number)) for number in range(len(sets))]
    points, triangles = counted(len(samples), "point"), counted(len(mesh.scene.faces), "triangle")
    told = [
        ("samples", dotted, f"{points} on the surface", "Uniform by area. Spheres are fitted to them."),
        ("mesh", drawn, triangles, "What the spheres stand in for, and its soft shadow."),
    ]
    for entry, picture, leaving in zip(fitted, balls, beyond, strict=True):
        method, count = entry.spheres.method, counted(len(entry.spheres), "sphere")
        quality = f"silhouette IoU {entry.silhouette_iou:.3f}, surface error {entry.surface_error:.4f} of the diagonal"
        cut = (
            f" {counted(leaving, 'sphere')} beyond {REACH} radii of the mesh may leave the picture." if leaving else ""
        )
        told.append((method, picture, count, f"{_METHODS[method]}; {quality}. The shadow is theirs.{cut}"))
    return tuple(
        Figure(f"1_5_{name}", picture, f"Figure 1.5, {name}: {shown}\n{more}") for name, picture, shown, more in told
    )


def _draw_points(picture: Picture, stage: Stage, points: Float64Array) -> Picture:
    """Draw dots on those points, (s, 3) in the mesh's coordinates, that the first view of a stage sees."""
    camera, depths = stage.cameras[0], stage.depths()
    height, width = depths.shape
    column, row, depth = camera.project(stage.frame.points(points)).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row, depth = column[inside], row[inside], depth[inside]
    pixel = 2 * camera.tangent / height  # at depth 1
    in_front = depth <= depths[row.astype(int), column.astype(int)] + _DEPTH_PIXELS * pixel * depth
    column, row = column[in_front], row[in_front]
    area = np.count_nonzero(np.isfinite(depths)) / max(len(column), 1)  # pixels for each dot
    radius = min(max(math.sqrt(_DOTS_SHARE * area / math.pi), _MIN_DOT), _MAX_DOT)
    cover = np.zeros((height + 2 * _REACH, width + 2 * _REACH))
    for down, right in np.ndindex(2 * _REACH + 1, 2 * _REACH + 1):
        at_row, at_column = row.astype(int) + down, column.astype(int) + right  # in the padded picture
        distance = np.hypot(at_row - _REACH + 0.5 - row, at_column - _REACH + 0.5 - column)
        np.add.at(cover, (at_row, at_column), np.clip(max(radius, 0.5) + 0.5 - distance, 0, 1))
    cover *= min(2 * radius, 1) ** 2  # smaller dots are as large as a pixel, but fainter
    share = np.minimum(cover[_REACH:-_REACH, _REACH:-_REACH, None], 1)
    mixed: Picture = np.floor(picture * (1 - share) + np.array(_DOT) * share + 0.5).astype(np.uint8)
    return mixed


def figure_sheet(figures: Sequence[Figure], columns: int, title: str) -> Picture:
    """Lay out figures with their scales and captions."""
    pictures = [fit_picture(figure.picture, _CELL, _CELL) for figure in figures]
    height, cells = max(len(fitted) for fitted in pictures), []
    for figure, fitted in zip(figures, pictures, strict=True):
        cell: Picture = np.full((height, _CELL, 3), PAGE, np.uint8)
        top, left = (height - fitted.shape[0]) // 2, (_CELL - fitted.shape[1]) // 2
        cell[top : top + fitted.shape[0], left : left + fitted.shape[1]] = fitted
        cells.append(cell if figure.scale is None else with_scale(cell, *figure.scale))
    whole_height = max(len(cell) for cell in cells)
    below = [np.full((whole_height - len(cell), _CELL, 3), PAGE, np.uint8) for cell in cells]
    whole = [np.concatenate(parts) for parts in zip(cells, below, strict=True)]
    return contact_sheet([(cell, figure.caption) for cell, figure in zip(whole, figures, strict=True)], columns, title)


def _unit_scale(low: str, high: str) -> tuple[Picture, Ticks]:
    greys = grey_picture(np.linspace(0, 1, 256, dtype=np.float32)[None])[0]
    return greys, [(0.0, f"0, {low}"), (0.5, "0.5"), (1.0, f"1, {high}")]


def _depth_figure(depths: Float64Array, nearest: float) -> tuple[Picture, tuple[Picture, Ticks]]:
    """Draw a depth map in greys, the darker the farther from the light; return it and its scale.

    nearest   the greatest depth of both maps, from which distances count
    """
    covered = np.isfinite(depths)
    distances = nearest - depths[covered]
    first, last = (float(distances.min()), float(distances.max())) if len(distances) else (0.0, 0.0)
    shares = np.zeros(depths.shape)
    shares[covered] = (distances - first) / max(last - first, np.finfo(np.float64).tiny)
    picture = np.where(covered[..., None], _depth_greys(shares), np.array(BACKGROUND, np.uint8))
    digits = f".{2 - math.floor(math.log10(last))}f" if 1e-3 < last < 100 else ".3g"
    ticks = [(share, f"{first + share * (last - first):{digits}}") for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    return picture, (_depth_greys(np.linspace(0, 1, 256)[None])[0], ticks)


def _depth_greys(shares: Float64Array) -> Picture:
    return grey_picture((_NEAREST + (_FARTHEST - _NEAREST) * shares).astype(np.float32))
