"""The examples run and do what they show."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from aoprecalc.io import load_scene

EXAMPLES = Path(__file__).parent.parent / "examples"
SHADERS = EXAMPLES / "shaders"


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


@pytest.mark.parametrize("version", ["330 core", "300 es"])
@pytest.mark.parametrize(
    ("snippets", "call"),
    [
        (["ambient"], "ambientLight(ambientOcclusion(baked, vec2(0.5)), vec3(seenThroughOpening(0.5, 0.5)))"),
        (["sphere_shadow"], "vec3(lightPastSpheres(vec3(0), vec3(0, 1, 0), 0.1), skyPastSpheres(vec3(0), vec3(1)), 1)"),
        (["sphere_shadow", "ground"], "shadedGround(vec3(0), vec3(1), vec3(0, 1, 0), vec3(1), vec3(1))"),
    ],
)
def test_snippets_compile(renderer, version, snippets, call):
    header = f"#version {version}\nprecision highp float;\nuniform sampler2D baked;\nout vec4 pixel;\n"
    text = "\n".join((SHADERS / f"{snippet}.glsl").read_text(encoding="utf-8") for snippet in snippets)
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
