"""Previews: a mesh with its ambient-occlusion texture, and its spheres, on a soft ground."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aoprecalc.gl.context import TriangleDrawer
from aoprecalc.mesh.roles import up_axis
from aoprecalc.options import PreviewOptions
from aoprecalc.progress import Progress
from aoprecalc.render.camera import Camera, PictureFrame, frame_views, view_axes
from aoprecalc.render.shading import PictureMesh, encode, shade, shade_spheres
from aoprecalc.render.shadow import (
    AreaLight,
    GroundShadow,
    cast_shadow,
    map_size,
    shadow_points,
    shadow_window,
    simplified,
    sky_directions,
)
from aoprecalc.render.visible_surface import Fragments, RayDrawer, SphereDrawer, SurfaceDrawer, fragments
from aoprecalc.types import Float32Array, Float64Array, Int32Array, Picture, Scene, TexturedMesh
from aoprecalc.visibility.backend import GLBackend, open_renderer_or_rays

Spheres = tuple[Float64Array, Float64Array]

_SAMPLES = 4  # along each side of a pixel
_MAX_SAMPLES = 1 << 25  # drawn at once
# The key light: degrees around the upward axis from the camera, degrees above the ground, angular radius in radians.
_TURN, _RISE, _RADIUS = -48.0, 52.0, np.radians(14.0)
_GROUND_TURN, _GROUND_RISE, _GROUND_RADIUS = -62.0, 47.0, np.radians(10.0)  # where shadows are compared
REACH = 1.25  # of the mesh's radii: spheres beyond do not count for the framing, and may leave the picture
_FILL, _SHADOW_FILL = 0.84, 0.95  # share of the picture's width and height for the mesh, and for its shadow
_SHADOW_SHARE = 0.6  # share of the shadow that must be in the picture
_MIN_VIEW_RISE = 0.02  # of the camera's direction above the ground, where there is a ground
_CENTER, _CORNER = np.array([0.92, 0.92, 0.915], np.float32), np.array([0.76, 0.77, 0.775], np.float32)  # backdrop
_KEY_SHARE, _SKY_SHARE = 0.38, 0.52  # of the ground's light
_GROUND_KEY_SHARE, _GROUND_SKY_SHARE = 0.56, 0.34  # where shadows are compared
_ON_GROUND = 1e-4  # below the ground, up to which the mesh is seen
_GLASS = np.float32(0.35)  # opacity of parts that light passes through
_OVER, _RIM = 0.36, 0.54  # opacity of spheres over the mesh where one looks straight at them, and what rims add
_MAX_BEHIND = 0.3  # radii behind the mesh's surface at which they are hidden


def preview_pictures(
    mesh: TexturedMesh, spheres: Spheres | None, options: PreviewOptions, progress: Progress
) -> list[Picture]:
    """Draw a mesh, one picture for each view or frame.

    Parameters
    ----------
    mesh : TexturedMesh
        With at least one face.
    spheres : tuple of ndarray, or None
        Centres (n, 3) float64 in the mesh's coordinates, and radii (n,) float64 >= 0.
    options : PreviewOptions
        What to draw, from where, and how large.
    progress : Progress
        Counts the pictures.

    Returns
    -------
    list of ndarray, (height, width, 3) uint8
        sRGB, row 0 on top. Spheres beside the mesh, and the shadows that `ground` compares, share the width.

    Raises
    ------
    RendererError
        Where there is neither OpenGL nor a ray tracer.
    """
    panels = _panels(spheres, options)
    width = -(-options.width // len(panels))
    pictures = []
    with (
        open_stage(mesh, [] if spheres is None else [spheres], width, options, progress) as stage,
        progress.stage("draw", len(stage.cameras), "pictures"),
    ):
        for view in range(len(stage.cameras)):
            drawings = [stage.draw(panel, view) for panel in panels]
            drawings[0] = drawings[0][:, : options.width - width * (len(panels) - 1)]
            pictures.append(np.concatenate(drawings, axis=1))
            progress.advance()
    return pictures


@contextmanager
def open_stage(
    mesh: TexturedMesh,
    sets: Sequence[Spheres],
    width: int,
    options: PreviewOptions,
    progress: Progress,
) -> Iterator["Stage"]:
    """Put a mesh and sets of spheres on the ground, to draw them by the same cameras and lights.

    width   of a panel
    """
    frame = PictureFrame.from_positions(mesh.scene.positions, up_axis(mesh.scene, options))
    drawn = PictureMesh.from_mesh(mesh, frame)
    balls = [(frame.points(centers), radii / frame.radius) for centers, radii in sets]
    near = [np.linalg.norm(centers, axis=1) + sizes <= REACH for centers, sizes in balls]
    framed = [(centers[chosen], sizes[chosen]) for (centers, sizes), chosen in zip(balls, near, strict=True)]
    points = _bounds(frame.points(mesh.scene.positions), framed)
    ground = _ground_height(mesh.scene, frame, points)
    azimuths = _azimuths(options)
    lights = [_light(azimuth, options.ground) for azimuth in azimuths]
    views = []
    for azimuth, light in zip(azimuths, lights, strict=True):
        axes = view_axes(azimuth, options.elevation)
        share = 0.0 if not _sees_ground(axes) else 1.0 if options.ground else _SHADOW_SHARE
        shadow = points + share * (shadow_points(points, ground, light) - points)
        views.append((axes, [(points, _FILL), (shadow, _SHADOW_FILL)]))
    cameras = frame_views(views, width, options.height)
    window = shadow_window(points, ground, lights)
    sphere_drawers = [SphereDrawer(*ball) for ball in balls]
    with open_drawers(drawn, options, progress, ground) as (drawer, glass):
        yield Stage(
            frame,
            drawn,
            drawer,
            glass,
            balls,
            [int(np.count_nonzero(~chosen)) for chosen in near],
            sphere_drawers,
            points,
            ground,
            window,
            cameras,
            lights,
            options,
        )


def _ground_height(scene: Scene, frame: PictureFrame, points: Float64Array) -> float:
    """Return the height of the ground in a picture: where it was in the bake, else that of the lowest of the points."""
    lowest = float(points[:, 1].min())
    ground = scene.around.ground
    if ground is None or ground.height is None:
        return lowest
    up = np.asarray(ground.normal)
    if frame.rotation[1] @ up < 1:  # the picture has another axis upwards
        return lowest
    return float(frame.points(ground.height * up)[1])


@contextmanager
def open_drawers(
    mesh: PictureMesh, options: PreviewOptions, progress: Progress, ground: float
) -> Iterator[tuple[SurfaceDrawer, SurfaceDrawer | None]]:
    """Open what draws the mesh, and its glass, if any: OpenGL or rays, as the options ask for.

    What lies below the ground casts no shadow.
    """
    with open_renderer_or_rays(options.backend, options.threads, progress) as renderer:

        def drawer(corners: Float32Array, casters: Float32Array) -> SurfaceDrawer:
            if renderer is None:
                return RayDrawer(corners, casters, options.threads)
            return TriangleDrawer(renderer, corners, casters)

        above = mesh.opaque.corners[(mesh.opaque.corners[:, :, 1] >= ground).any(axis=1)]
        opaque = drawer(mesh.opaque.corners, simplified(above if len(above) else mesh.opaque.corners[:1]))
        yield opaque, None if mesh.glass is None else drawer(mesh.glass.corners, mesh.glass.corners[:1])
        if renderer is not None:
            GLBackend(renderer).check_errors()


def _azimuths(options: PreviewOptions) -> list[float]:
    count = options.frames if options.turntable else options.views
    return [options.azimuth + 360 * number / count for number in range(count)]


def _light(azimuth: float, ground: bool) -> AreaLight:
    """Return the key light of a camera: to its left, above; `ground` is where shadows are compared."""
    turn, rise, radius = (_GROUND_TURN, _GROUND_RISE, _GROUND_RADIUS) if ground else (_TURN, _RISE, _RADIUS)
    x, y, z = view_axes(azimuth + turn, rise)[2].tolist()
    return AreaLight((x, y, z), radius)


def _sees_ground(axes: Float64Array) -> bool:
    """Tell whether a camera with these axes looks down on the ground."""
    return float(axes[2, 1]) > _MIN_VIEW_RISE


@dataclass(frozen=True)
class Panel:
    """What a picture, or a part of one, shows.

    mesh        the mesh
    spheres     which set of spheres; None: no spheres
    shadow_of   which set casts the shadow on the ground; None: the mesh
    """

    mesh: bool = True
    spheres: int | None = None
    shadow_of: int | None = None


def _panels(spheres: Spheres | None, options: PreviewOptions) -> list[Panel]:
    """Return the panels of a picture, from left to right."""
    if spheres is None:
        return [Panel()]
    if options.spheres_view == "beside":
        return [Panel(), Panel(mesh=False, spheres=0, shadow_of=0)]
    return [Panel(), Panel(shadow_of=0)] if options.ground else [Panel(spheres=0)]


def _bounds(points: Float64Array, sets: Sequence[Spheres]) -> Float64Array:
    """Return points, (k, 3), that bound the mesh and the spheres above the ground below it."""
    corners = [
        centers + radii[:, None] * (2 * np.array(signs) - 1) for centers, radii in sets for signs in np.ndindex(2, 2, 2)
    ]
    bounds = np.concatenate([points, *corners])
    bounds[:, 1] = np.maximum(bounds[:, 1], points[:, 1].min())
    return bounds


@dataclass(frozen=True, eq=False)
class Stage:
    """What stands on the ground, in the picture's frame, and the cameras and lights of each view.

    sets       sets of spheres
    beyond     of each set, how many spheres do not count for the framing
    points     (k, 3) float64: bounds of the mesh and of the spheres that count
    ground     the ground's height
    window     the part of the ground that has shadows, see GroundShadow
    """

    frame: PictureFrame
    mesh: PictureMesh
    mesh_drawer: SurfaceDrawer
    glass_drawer: SurfaceDrawer | None
    sets: Sequence[Spheres]
    beyond: Sequence[int]
    sphere_drawers: Sequence[SurfaceDrawer]
    points: Float64Array
    ground: float
    window: Float64Array
    cameras: Sequence[Camera]
    lights: Sequence[AreaLight]
    options: PreviewOptions

    def draw(self, panel: Panel, view: int = 0) -> Picture:
        """Draw one panel of a view."""
        camera, light = self.cameras[view], self.lights[view]
        shadow = self._shadow(panel.shadow_of, light) if _sees_ground(camera.axes) else None
        rows = max(_MAX_SAMPLES // (camera.width * _SAMPLES * _SAMPLES), 1)
        return np.concatenate([self._draw_band(panel, band, light, shadow) for band in camera.bands(rows)])

    def depths(self, view: int = 0) -> Float32Array:
        """Return the depth of the mesh along a view in each pixel, (height, width); inf where it is not seen."""
        camera = self.cameras[view]
        seen = self._fragments(self.mesh_drawer, camera, self.mesh.opaque.face_of)
        along = shade(self.mesh, seen, camera, self.lights[view], "clay")[1]
        return _nearest(along, seen, camera.width * camera.height).reshape(camera.shape)

    def _shadow(self, caster: int | None, light: AreaLight) -> GroundShadow:
        drawer = self.mesh_drawer if caster is None else self.sphere_drawers[caster]
        size = map_size(max(self.cameras[0].width, self.cameras[0].height))
        key = cast_shadow(drawer, light.directions(), self.ground, self.window, size)
        if caster not in self._sky_shadows:
            self._sky_shadows[caster] = cast_shadow(drawer, sky_directions(), self.ground, self.window, size)
        return GroundShadow(self.ground, self.window, key, self._sky_shadows[caster])

    @cached_property
    def _sky_shadows(self) -> dict[int | None, Float32Array]:
        """The shadows in the light of the sky that were cast so far, by their caster."""
        return {}

    def _draw_band(self, panel: Panel, camera: Camera, light: AreaLight, shadow: GroundShadow | None) -> Picture:
        linear = _backdrop(camera, shadow, self.options.ground).reshape(-1, 3)
        depth = np.full(len(linear), np.inf, np.float32)
        if panel.mesh:
            seen = self._fragments(self.mesh_drawer, camera, self.mesh.opaque.face_of)
            colors, along = shade(self.mesh, seen, camera, light, self.options.shading)
            weight = seen.weight
            if shadow is not None and shadow.height > self.points[:, 1].min():
                weight = np.where(_heights(seen, along, camera) < shadow.height - _ON_GROUND, np.float32(0), weight)
            _composite(linear, colors, seen.pixel, weight)
            depth = _nearest(along, seen, len(linear))
        if panel.mesh and self.mesh.glass is not None and self.glass_drawer is not None:
            seen = self._fragments(self.glass_drawer, camera, self.mesh.glass.face_of)
            colors, along = shade(self.mesh, seen, camera, light, self.options.shading)
            _composite(linear, colors, seen.pixel, seen.weight * np.where(along < depth[seen.pixel], _GLASS, 0))
        if panel.spheres is not None:
            seen = self._fragments(self.sphere_drawers[panel.spheres], camera)
            colors, along, facing = shade_spheres(*self.sets[panel.spheres], seen, camera, light)
            weight = seen.weight
            if panel.mesh:
                behind = np.clip((along - depth[seen.pixel]) / _MAX_BEHIND, 0, 1)
                weight = weight * (_OVER + _RIM * (1 - facing) ** 2) * (1 - behind)
            if shadow is not None:
                weight = np.where(_heights(seen, along, camera) < shadow.height, 0, weight)
            _composite(linear, colors, seen.pixel, weight.astype(np.float32))
        return encode(linear).reshape(*camera.shape, 3)

    def _fragments(self, drawer: SurfaceDrawer, camera: Camera, face_of: Int32Array | None = None) -> Fragments:
        """Return what a camera sees; `face_of` is the index that each of the drawer's indices stands for."""
        height, width = camera.shape
        samples = max(min(_SAMPLES, drawer.max_size // max(height, width)), 1)
        indices = drawer.visible(camera.clip_matrix(self.points), width * samples, height * samples)
        seen = fragments(indices, samples)
        return seen if face_of is None else replace(seen, index=face_of[seen.index])


def _heights(seen: Fragments, along: Float32Array, camera: Camera) -> Float64Array:
    """Return the heights of fragments, (k,), at the depths `along`."""
    heights: Float64Array = camera.eye[1] + along * camera.rays(seen.x, seen.y + camera.rows[0])[:, 1]
    return heights


def _nearest(depths: Float32Array, seen: Fragments, pixels: int) -> Float32Array:
    """Return the least depth of the fragments in each pixel, (pixels,); inf where there is none."""
    nearest = np.full(pixels, np.inf, np.float32)
    first = np.flatnonzero(np.diff(seen.pixel, prepend=-1))
    if len(first):
        nearest[seen.pixel[first]] = np.minimum.reduceat(depths, first)
    return nearest


def _composite(linear: Float32Array, colors: Float32Array, pixel: Int32Array, weight: Float32Array) -> None:
    """Lay fragments over (n, 3) pixels: those of one pixel beside each other, in shares of `weight`."""
    linear *= (1 - np.bincount(pixel, weight, len(linear)).astype(np.float32))[:, None]
    for channel in range(3):
        linear[:, channel] += np.bincount(pixel, colors[:, channel] * weight, len(linear)).astype(np.float32)


def _backdrop(camera: Camera, shadow: GroundShadow | None, ground: bool) -> Float32Array:
    """Return the backdrop with the ground's shadow, (rows, width, 3) linear: brightest in the middle."""
    across = ((2 / camera.width) * (np.arange(camera.width) + 0.5) - 1).astype(np.float32)
    down = ((2 / camera.height) * (np.arange(*camera.rows) + 0.5) - 1).astype(np.float32)
    distance = (across**2 + down[:, None] ** 2) / 2
    share = distance / (distance + np.float32(0.6)) * np.float32(1.6)
    linear = np.asarray(_CENTER + (_CORNER - _CENTER) * share[..., None], np.float32)
    if shadow is not None:
        shares = (_GROUND_KEY_SHARE, _GROUND_SKY_SHARE) if ground else (_KEY_SHARE, _SKY_SHARE)
        linear *= shadow.light(camera, *shares)[..., None]
    return linear
