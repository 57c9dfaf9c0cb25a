"""The examples run and do what they show."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from aoprecalc.io import load_scene

EXAMPLES = Path(__file__).parent.parent / "examples"
SHADERS = EXAMPLES / "shaders"
SIZE = (320, 180)


def run(script, *arguments):
    """Run an example as `python examples/SCRIPT ARGUMENTS...` would; returns its exit code and its names."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [script, *map(str, arguments)])
        try:
            return 0, runpy.run_path(str(EXAMPLES / script), run_name="__main__")
        except SystemExit as end:
            return end.code or 0, {}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    run("make_meshes.py", folder)
    return folder


@pytest.fixture(scope="module")
def assets(meshes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    options = ["--size", 128, "--directions", 64, "--spheres", 80]
    code, _ = run("bake_and_fit.py", meshes / "colonnade.obj", meshes / "arches.stl", "-o", folder, *options)
    assert code == 0
    return folder


def rendered(assets, stem, kind, *options):
    """Render the assets of a mesh; returns the mesh, the picture in [0, 1] and the names of render.py."""
    mesh, picture = assets / f"{stem}_ao.{kind}", assets / f"{stem}.png"
    inputs = [mesh, assets / f"{stem}_ao.png", assets / f"{stem}_spheres.json"]
    code, names = run("render.py", *inputs, "-o", picture, "--size", *SIZE, *options)
    assert code == 0
    return load_scene(mesh), np.asarray(Image.open(picture).convert("RGB"), float) / 255, names


@pytest.mark.parametrize("name", ["colonnade.obj", "rings.ply", "arches.stl"])
def test_meshes_are_closed_and_have_no_uvs(meshes, name):
    mesh = trimesh.load(meshes / name)
    assert load_scene(meshes / name).uvs is None
    assert mesh.is_watertight
    assert mesh.body_count == 1 or name != "colonnade.obj"  # no faces touch, so that no texel is dark
    assert mesh.is_winding_consistent
    assert mesh.volume > 0


def test_bake_and_fit_writes_the_assets_of_every_mesh(assets):
    assert {file.name for file in assets.iterdir()} >= {
        *("colonnade_ao.png", "colonnade_ao.obj", "colonnade_ao.mtl", "colonnade_spheres.json"),
        *("arches_ao.png", "arches_ao.glb", "arches_spheres.json"),
    }


def test_bake_and_fit_says_what_is_wrong(tmp_path, capsys):
    code, _ = run("bake_and_fit.py", tmp_path / "missing.obj", "-o", tmp_path)
    assert code == 4
    assert capsys.readouterr().err.startswith("error: ")
    assert not list(tmp_path.iterdir())


@pytest.mark.gl
def test_render_shows_the_mesh_and_its_shadow_on_the_ground(assets):
    scene, picture, names = rendered(assets, "colonnade", "obj")
    assert picture.shape == (SIZE[1], SIZE[0], 3)
    assert picture.std() > 0.05
    assert picture.max() < 1

    def brightness(ground_point):
        """Of the picture where it shows a point of the ground."""
        x, y, _, w = matrix @ [*ground_point, 1.0]
        column, row = (1 + x / w) * SIZE[0] / 2, (1 - y / w) * SIZE[1] / 2
        return picture[int(row), int(column)].mean()

    points, aspect = scene.corners.reshape(-1, 3), SIZE[0] / SIZE[1]
    floor, light = points[:, 1].min(), names["LIGHT"]
    shadow = points - light * (points[:, 1:2] - floor) / light[1]
    matrix = names["camera_matrix"](names["place_camera"](np.concatenate([points, shadow]), aspect), points, aspect)
    ridge_end = points[np.argmax(points @ [1.0, 10.0, 0.0])] - [0.3, 0.3, 0.0]
    in_shadow = ridge_end - light * (ridge_end[1] - floor) / light[1]
    beside = np.array([points[:, 0].min(), floor, points[:, 2].max() + 0.15])
    far = np.array([points[:, 0].max() + 2.0, floor, points[:, 2].max()])
    assert brightness(in_shadow) < 0.85 * brightness(far)
    assert brightness(beside) < brightness(far) - 0.01  # in the sun, but close to the steps
    assert brightness(far) > 0.8


@pytest.mark.gl
def test_render_draws_several_sphere_sets_one_below_the_other(assets, tmp_path):
    inputs = [assets / "colonnade_ao.obj", assets / "colonnade_ao.png", assets / "colonnade_spheres.json"]
    small = tmp_path / "one_small.csv"
    small.write_text("x,y,z,radius\n0,0,0,0.01\n")
    code, _ = run("render.py", *inputs, small, "-o", tmp_path / "both.png", "--size", *SIZE)
    assert code == 0
    both = np.asarray(Image.open(tmp_path / "both.png"), float)
    assert both.shape == (2 * SIZE[1], SIZE[0], 3)
    upper, lower = np.split(both, 2)
    assert (upper < lower - 20).any(axis=2).mean() > 0.02  # the first set's shadow on the ground


@pytest.mark.gl
def test_render_turns_z_up(assets):
    _, upright, _ = rendered(assets, "arches", "glb", "--up", "z")
    _, lying, _ = rendered(assets, "arches", "glb")
    assert np.abs(upright - lying).max() > 0.2


@pytest.mark.gl
def test_render_says_what_is_wrong(assets, meshes, tmp_path, capsys):
    inputs = [meshes / "colonnade.obj", assets / "colonnade_ao.png", assets / "colonnade_spheres.json"]
    code, _ = run("render.py", *inputs, "-o", tmp_path / "picture.png")
    assert code == 4
    assert "has no UVs" in capsys.readouterr().err


@pytest.mark.parametrize("version", ["330 core", "300 es"])
@pytest.mark.parametrize(
    ("snippet", "call"),
    [
        ("ambient.glsl", "ambientLight(ambientOcclusion(baked, vec2(0.5)), vec3(seenThroughOpening(0.5, 0.5)))"),
        (
            "sphere_shadow.glsl",
            "vec3(lightPastSpheres(vec3(0), vec3(0, 1, 0), 0.1), skyPastSpheres(vec3(0), vec3(1)), 1)",
        ),
    ],
)
def test_snippets_compile(renderer, version, snippet, call):
    header = f"#version {version}\nprecision highp float;\nuniform sampler2D baked;\nout vec4 pixel;\n"
    text = (SHADERS / snippet).read_text(encoding="utf-8")
    renderer.context.program(
        vertex_shader=f"#version {version}\nvoid main() {{ gl_Position = vec4(0.0); }}",
        fragment_shader=f"{header}{text}\nvoid main() {{ pixel = vec4({call}, 1.0); }}",
    )


def test_a_sphere_hides_what_counting_directions_finds(renderer):
    """Of a round light and of the sky, over the upper half space seen from the origin."""
    angle, light = 0.3, np.array([0.48, 0.8, 0.36])
    spheres = np.array([[1, 2, 1, 0.8], [1.5, 1, 0.5, 0.6], [3, 0.2, 0, 1], [-1, -0.2, 2, 0.9], [0.4, 1, 0.6, 0.1]])
    text = (SHADERS / "sphere_shadow.glsl").read_text(encoding="utf-8")
    program = renderer.context.program(
        vertex_shader=f"""#version 330 core
            {text}
            in vec4 sphere;
            uniform vec3 light;
            uniform float angle;
            out vec2 hidden;
            void main() {{
                hidden.x = hiddenBySphere(vec3(0.0), light, angle, sphere);
                hidden.y = skyHiddenBySphere(vec3(0.0), vec3(0.0, 1.0, 0.0), sphere);
            }}""",
        varyings=["hidden"],
    )
    program["light"], program["angle"] = tuple(light), angle
    renderer.context.simple_framebuffer((1, 1)).use()  # nothing is drawn, but OpenGL wants a place to draw to
    results = renderer.context.buffer(reserve=8 * len(spheres))
    rows = renderer.context.buffer(spheres.astype("f4").tobytes())
    renderer.context.vertex_array(program, rows, "sphere").transform(results, 0, vertices=len(spheres))
    found = np.frombuffer(results.read(), "f4").reshape(-1, 2)

    directions = np.random.default_rng(0).normal(size=(400_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    in_light, cosine = directions @ light > np.cos(angle), np.maximum(0, directions[:, 1])
    for sphere, (light_share, sky_share) in zip(spheres, found, strict=True):
        away = np.linalg.norm(sphere[:3])
        hit = directions @ sphere[:3] / away > np.sqrt(1 - (sphere[3] / away) ** 2)
        assert light_share == pytest.approx(hit[in_light].mean(), abs=0.02)
        assert sky_share == pytest.approx((hit * cosine).sum() / cosine.sum(), abs=0.005)
