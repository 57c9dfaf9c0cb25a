"""The light of a sky: closed forms by maps, by rays and by the reference; images; what is no sky."""

import json

import numpy as np
import OpenImageIO
import pytest
import trimesh

import aoprecalc as ao
from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.surroundings import with_surroundings
from aoprecalc.errors import ArgumentError, InputError
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.mesh.surface import SurfacePoints
from aoprecalc.metrics.reference import reference_ao
from aoprecalc.options import BakeOptions, ValueOptions, VerifyOptions
from aoprecalc.progress import Progress
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.sky import ImageSky, sky_image
from pipeline.helpers import run
from shapes import box, clutter, quad, quad_uvs, scene_of_parts

BACKENDS = ["gl", "ray", "reference"]
FRAME = np.array([(1, 0, 0), (0, -1, 0), (0, 0, 1.0)])  # of the axis z


def saved(path, values):
    """Write (h, w) values as a grey image."""
    pixels = np.repeat(np.asarray(values, np.float32)[..., None], 3, axis=2)
    assert OpenImageIO.ImageBuf(np.ascontiguousarray(pixels)).write(str(path))
    return path


def patch_and(shape):
    """A small square that faces +z at the origin, and an occluder."""
    patch = quad((-0.001, -0.001, 0), (0.002, 0, 0), (0, 0.002, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1)), np.zeros((len(shape[1]), 3, 2))])
    return scene_of_parts(patch, shape, uvs=uvs)


def value(made, backend, **options):
    """The AO of the patch."""
    if backend != "reference":
        chosen = BakeOptions(size=8, directions=8000, unwrap="keep", only="part 0", backend=backend, **options)
        texture = bake_scene(made, chosen).texture
        return float(texture.values[texture.valid].mean())
    how = ValueOptions(only="part 0", **options)
    made = with_surroundings(assign_roles(made, how), how)
    middle = SurfacePoints(np.zeros(20, int), np.tile((0.5, 0.0, 0.5), (20, 1)))
    shading = np.broadcast_to(np.float32((0, 0, 1)), (len(made.faces), 3, 3))
    points = reference_ao(made, shading, middle, VerifyOptions(), Progress(), Integrand.from_options(how, made))
    return float(points.mean())


def ring_wall(sine, sides=256):
    """A wall around the origin that hides all below an elevation."""
    angle = 2 * np.pi * np.arange(sides) / sides
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    height = sine / np.sqrt(1 - sine**2)
    positions = np.concatenate([np.column_stack([around, np.full(sides, z)]) for z in (-0.1, height)])
    a, b = np.arange(sides), (np.arange(sides) + 1) % sides
    return positions, np.concatenate([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("sine", [0.3, 0.8])
def test_an_overcast_sky_loses_less_below_a_horizon_than_a_uniform_one(backend, sine):
    """Of the light on a level floor, the integral of (1 + 2 s) s ds, a wall up to s takes (3 s^2 + 4 s^3) / 7."""
    made = patch_and(ring_wall(sine))
    assert value(made, backend) == pytest.approx(1 - sine**2, abs=0.01)
    assert value(made, backend, sky="overcast", up="z") == pytest.approx(1 - (3 * sine**2 + 4 * sine**3) / 7, abs=0.01)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("side", [1, -1])
def test_a_wall_hides_its_half_of_an_image(backend, side, tmp_path):
    """Three quarters of the light come from +x, which is the middle of the image."""
    columns = np.where(abs(np.arange(128) - 63.5) < 32, 3.0, 1.0)
    sky = saved(tmp_path / "sky.exr", np.tile(columns, (64, 1)))
    wall = quad((side * 0.002, -500, -1), (0, 1000, 0), (0, 0, 1000))
    expected = 0.25 if side == 1 else 0.75
    assert value(patch_and(wall), backend, sky=sky, up="z") == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_sun_of_one_pixel_is_neither_missed_nor_blurred(backend, tmp_path):
    image = np.zeros((256, 512))
    image[64, 256] = 1000  # at an elevation of 45 degrees over +x
    sky = saved(tmp_path / "sky.hdr", image)
    before, behind = (quad((side * 0.5, -500, -1), (0, 1000, 0), (0, 0, 1000)) for side in (1, -1))
    assert value(patch_and(before), backend, sky=sky, up="z") < 0.02
    assert value(patch_and(behind), backend, sky=sky, up="z") > 0.98


def with_sun(share, height=64):
    """An image of a uniform sky, and a pixel at 30 degrees from the zenith that has this share of all light."""
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    areas = np.repeat(-np.diff(edges)[:, None] / (4 * height), 2 * height, axis=1)  # of pixels, of a sphere of area 1
    image = np.ones((height, 2 * height))
    image[height // 6, 7] += share / (1 - share) / areas[height // 6, 7]
    return image


@pytest.mark.parametrize("share", [0.2, 0.9])
@pytest.mark.parametrize("directions", [100, 1000, 20_000])
@pytest.mark.parametrize("height", [12, 64, 300])
def test_the_share_of_the_brightest_direction_is_that_of_the_sun(share, directions, height):
    """Beside the sun itself it has 1 / n of the sky; a pixel that is larger than that gives it a part of its light."""
    found = ImageSky(sky_image(with_sun(share, height)[..., None].astype(np.float32)), FRAME).share_in_one(directions)
    pixel = -np.diff(np.cos(np.pi * (height // 6 + np.arange(2)) / height))[0] / (4 * height)
    held = min(1, 1 / (directions * pixel))
    assert found == pytest.approx(share * held + (1 - share) / directions, rel=0.02, abs=0.3 / directions)


@pytest.mark.parametrize("directions", [100, 400, 2000])
@pytest.mark.parametrize("degrees", [3, 10, 30])
def test_so_is_that_of_a_window_of_equal_pixels(degrees, directions):
    """Beside that of the light around each direction, which the bake takes."""
    image = np.full((180, 360), 0.01, np.float32)
    image[60 : 60 + degrees, 100 : 100 + degrees] = 1
    sky, axes = ImageSky(image, FRAME), light_axes(directions)
    cells = sky.averaged(np.concatenate([axes, -axes])).values
    expected = cells.max() / cells.sum()
    assert expected * 0.8 < sky.share_in_one(directions) < expected * 2.2  # greater where it lies between directions


@pytest.mark.parametrize(("share", "directions", "warned"), [(0.2, 512, True), (0.03, 512, False), (0, 16, False)])
def test_a_sun_in_a_sky_is_told(share, directions, warned, tmp_path):
    sky = saved(tmp_path / "sky.exr", with_sun(share))
    report = ao.bake(ao.Mesh(*box()), BakeOptions(sky=sky, size=16, directions=directions, up="z")).report
    told = (
        "sky.exr: 20% of its light comes from one of 512 directions, as from a sun: its shadow is hard and up to 5 deg"
    )
    assert any(line.startswith(told) for line in report.warnings) == warned


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_an_image_stands_upright_and_right_way_round(up):
    image = sky_image(np.arange(1.0, 33).reshape(4, 8, 1).astype(np.float32))
    frames = {"x": ("z", "y", "x"), "y": ("x", "z", "y"), "z": ("x", "-y", "z")}
    units = {sign + axis: (-1 if sign else 1) * np.eye(3)["xyz".index(axis)] for axis in "xyz" for sign in ("", "-")}
    middle, right, top = (units[name] for name in frames[up])
    sky = ImageSky(image, np.array([middle, right, top]))
    level = [middle + 0.1 * right, right - 0.1 * middle]
    found = sky.radiance(np.array([v / np.linalg.norm(v) for v in [*level, top + 0.01 * middle + 0.001 * right]]))
    assert found.tolist() == [image[2, 4], image[2, 6], image[0, 4]]


@pytest.mark.parametrize("directions", [64, 1000])
@pytest.mark.parametrize("height", [4, 100])
def test_around_the_directions_is_all_the_light_seed_1(directions, height):
    image = sky_image(np.random.default_rng(1).random((height, 2 * height, 1), np.float32))
    axes = light_axes(directions)
    cells = ImageSky(image, FRAME).averaged(np.concatenate([axes, -axes]))
    areas = np.sin(np.pi * (np.arange(height) + 0.5) / height)
    assert cells.values.mean() == pytest.approx(np.average(image.mean(axis=1), weights=areas), rel=0.01)
    same = ImageSky(np.full((height, 2 * height), 5.0, np.float32), FRAME).averaged(np.concatenate([axes, -axes]))
    assert same.values == pytest.approx(5.0)


def test_directions_are_drawn_as_their_density_says_seed_2():
    rng = np.random.default_rng(2)
    sky = ImageSky(sky_image(rng.random((16, 32, 1), np.float32) ** 4), FRAME)
    drawn = sky.sample((np.arange(200_000) + rng.random(200_000)) / 200_000, rng.random((200_000, 2)))
    assert np.linalg.norm(drawn, axis=1) == pytest.approx(1)
    assert (1 / sky.density(drawn)).mean() == pytest.approx(4 * np.pi, rel=0.01)
    for unit in np.eye(3):  # moments of the density, by quadrature
        axes = light_axes(100_000)
        everywhere = np.concatenate([axes, -axes])
        expected = (sky.density(everywhere) * (everywhere @ unit)).mean() * 4 * np.pi
        assert (drawn @ unit).mean() == pytest.approx(expected, abs=0.005)


def test_an_open_mesh_is_open_under_any_sky_seed_3(tmp_path):
    sky = saved(tmp_path / "sky.exr", np.random.default_rng(3).random((32, 64)) ** 8)
    for backend in ("gl", "ray"):
        for light in (sky, "overcast"):
            result = ao.bake(ao.Mesh(*box()), BakeOptions(size=64, directions=200, backend=backend, sky=light))
            assert result.ao[result.valid].min() == result.ao[result.valid].max() == 1


def test_maps_and_rays_agree_under_an_image_seed_4(tmp_path):
    sky = saved(tmp_path / "sky.exr", np.random.default_rng(4).random((32, 64)) ** 4)
    texture = {}
    for backend in ("gl", "ray"):
        options = BakeOptions(size=64, directions=256, backend=backend, sky=sky, unwrap="xatlas", shadow_size=1024)
        texture[backend] = ao.bake(ao.Mesh(*clutter(4)), options)
    valid = texture["gl"].valid & texture["ray"].valid
    assert np.sqrt(((texture["gl"].ao - texture["ray"].ao)[valid] ** 2).mean()) < 0.02


def test_verify_measures_under_the_sky_of_the_bake_seed_5(tmp_path):
    (tmp_path / "out").mkdir()
    sky = saved(tmp_path / "out" / "sky.hdr", np.tile(np.arange(64) < 16, (32, 1)))  # light from one side
    result = ao.bake(ao.Mesh(*clutter(5)), BakeOptions(size=256, directions=1000, sky=sky))
    made = result.save(tmp_path / "out" / "m.glb").mesh
    few = {"points": 1000, "rays": 400}
    found = ao.verify(made, options=VerifyOptions(**few))
    assert found.options.sky == "sky.hdr"
    assert found.error < 0.06
    assert ao.verify(made, options=VerifyOptions(sky="uniform", **few)).error > 2 * found.error


WRONG = {
    "missing.hdr": (None, "there is no such file"),
    "square.hdr": (np.ones((8, 8)), "has 8 x 8 pixels; an equirectangular image was expected"),
    "black.hdr": (np.zeros((8, 16)), "is black"),
    "nan.exr": (np.full((8, 16), np.nan), "not finite"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_no_sky_is_one_line(name, tmp_path):
    values, message = WRONG[name]
    if values is not None:
        saved(tmp_path / name, values)
    with pytest.raises(InputError, match=message):
        ao.bake(ao.Mesh(*box()), BakeOptions(size=64, directions=64, sky=tmp_path / name))


def test_a_sky_has_an_axis_that_points_up_and_no_plain_mean():
    assert BakeOptions(sky="overcast", up="z").up == "z"
    with pytest.raises(ArgumentError, match="up is 'z', but there is no ground and no sky"):
        BakeOptions(up="z")
    with pytest.raises(ArgumentError, match="estimator is 'mean', whose divisor is that of a uniform sky"):
        BakeOptions(sky="overcast", estimator="mean")
    baked = ValueOptions(sky="overcast", up="z")
    assert VerifyOptions(sky="uniform").value_options(baked).up == "auto"
    assert VerifyOptions(ground=True).value_options(baked).up == "z"


def test_the_command_line_takes_a_word_or_a_file(tmp_path):
    saved(tmp_path / "sky.hdr", np.tile(np.arange(16) < 8, (8, 1)))  # light from one side
    trimesh.Trimesh(*clutter(6), process=False).export(tmp_path / "b.obj")
    means = set()
    for sky in ("uniform", "overcast", "sky.hdr"):
        done = run(tmp_path, "bake", "b.obj", "--sky", sky, "--size", 64, "-n", 64, "--json", "-q")
        means.add(json.loads(done.stdout)["ao"]["mean"])
    assert len(means) == 3
    for wrong, code in (("over", 2), ("gone.hdr", 4)):
        done = run(tmp_path, "bake", "b.obj", "--sky", wrong, "--size", 64, "-n", 64)
        assert (done.returncode, len(done.stderr.splitlines())) == (code, 1)
