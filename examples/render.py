"""Renders a mesh with its ambient-occlusion texture, and the soft shadow that its spheres cast on the ground.

    python examples/render.py MESH_WITH_UVS TEXTURE SPHERES.json... -o picture.png

Several sphere sets are drawn one below the other, each under its file's name. The lighting is in shaders/ambient.glsl
and shaders/sphere_shadow.glsl, which any OpenGL renderer can take over; the rest, here and in shaders/studio, is a
small photographer's studio.
"""

import argparse
from pathlib import Path

import moderngl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from aoprecalc import AoprecalcError, InputError
from aoprecalc.gl.context import open_renderer
from aoprecalc.io import load_scene, read_image
from aoprecalc.io.sphere_files import read_spheres
from aoprecalc.mesh.surface import shading_normals


def unit(*vector: float) -> np.ndarray:
    """Return a vector divided by its length."""
    return np.array(vector) / np.linalg.norm(vector)


SHADERS = Path(__file__).parent / "shaders"
VERSION = "#version 330 core\n"
LIGHT = unit(-0.62, 0.64, 0.36)  # towards the sun
FORWARD = unit(-0.5, -0.3, -0.81)  # where the camera looks
TANGENT = 0.24  # of half the camera's vertical angle of view
MARGIN = 0.86  # share of the picture that the mesh and its shadow may fill
SAFE_MIP = 1  # further levels may mix charts; a renderer would take the level from the bake's report


def y_up(vectors: np.ndarray, up: str) -> np.ndarray:
    """Turn vectors, (..., 3), so that y points up."""
    return vectors if up == "y" else np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


def camera_axes() -> np.ndarray:
    """Return the camera's right, upward and forward unit vectors, (3, 3)."""
    right = unit(*np.cross(FORWARD, (0.0, 1.0, 0.0)))
    return np.stack([right, np.cross(right, FORWARD), FORWARD])


def place_camera(points: np.ndarray, aspect: float) -> np.ndarray:
    """Return where the camera stands, (3,), to see all points, (m, 3), from as near as it can."""
    *across, depth = (points @ camera_axes().T).T
    eye, nearest = [], np.inf
    for values, tangent in zip(across, (MARGIN * TANGENT * aspect, MARGIN * TANGENT), strict=True):
        # Each side of the picture is a plane through the eye with all points on one side.
        low, high = (values + tangent * depth).min(), (values - tangent * depth).max()
        eye.append((low + high) / 2)
        nearest = min(nearest, (low - high) / (2 * tangent))
    return np.array([*eye, nearest]) @ camera_axes()


def camera_matrix(eye: np.ndarray, points: np.ndarray, aspect: float) -> np.ndarray:
    """Return the (4, 4) matrix from positions to clip space."""
    depth = (points - eye) @ FORWARD
    near, far = 0.9 * depth.min(), 1.1 * depth.max()
    right, up, forward = camera_axes()
    rows = np.zeros((4, 4))
    rows[0, :3], rows[1, :3] = right / (TANGENT * aspect), up / TANGENT
    rows[2, :3], rows[3, :3] = forward * (far + near) / (far - near), forward
    rows[:, 3] = -rows[:, :3] @ eye
    rows[2, 3] -= 2 * far * near / (far - near)
    return rows


def program(context: moderngl.Context, name: str, snippets: list[str]) -> moderngl.Program:
    """Compile the studio's program `name`; its fragment shader can call the functions of the snippets."""
    texts = [SHADERS / snippet for snippet in snippets]
    texts += [SHADERS / "studio" / file for file in ("light.glsl", f"{name}.frag.glsl")]
    vertex = (SHADERS / "studio" / f"{name}.vert.glsl").read_text(encoding="utf-8")
    fragment = "\n".join(text.read_text(encoding="utf-8") for text in texts)
    return context.program(vertex_shader=VERSION + vertex, fragment_shader=VERSION + fragment)


def set_uniforms(program: moderngl.Program, **values) -> None:
    """Set uniforms: integers, numbers, vectors and matrices."""
    for name, value in values.items():
        program[name] = value if np.isscalar(value) else tuple(np.asarray(value).T.ravel())  # by columns


def draw(
    context: moderngl.Context, mesh: np.ndarray, occlusion: np.ndarray, spheres: np.ndarray, size: tuple[int, int]
) -> Image.Image:
    """Draw the picture.

    mesh        (m, 8): position, normal and UV at the corners of the triangles
    occlusion   (height, width) float32, the first row being v = 1
    spheres     (n, 4): centre and radius
    size        of the picture, width and height
    """
    points, aspect = mesh[:, :3], size[0] / size[1]
    ground = points[:, 1].min()
    shadow = points - LIGHT * ((points[:, 1:2] - ground) / LIGHT[1])
    eye = place_camera(np.concatenate([points, shadow]), aspect)
    matrix = camera_matrix(eye, points, aspect)
    rays = camera_axes() * [[TANGENT * aspect], [TANGENT], [1.0]]

    baked = context.texture(occlusion.shape[::-1], 1, np.flipud(occlusion).tobytes(), dtype="f4")
    baked.build_mipmaps(max_level=SAFE_MIP)
    baked.anisotropy = 8.0
    baked.use(0)
    context.texture((len(spheres), 1), 4, spheres.astype("f4").tobytes(), dtype="f4").use(1)

    stone = program(context, "mesh", ["ambient.glsl"])
    set_uniforms(stone, light=LIGHT, camera=matrix, baked=0)
    paper = program(context, "ground", ["ambient.glsl", "sphere_shadow.glsl"])
    set_uniforms(paper, light=LIGHT, rays=rays.T, eye=eye, ground=ground, spheres=1, sphereCount=len(spheres))
    target = context.simple_framebuffer(size, 3, samples=min(4, context.max_samples))
    target.use()
    target.clear()
    context.enable_only(moderngl.DEPTH_TEST)
    context.depth_func = "<="  # the ground lies at the far end of the depth range
    corners = context.buffer(mesh.astype("f4").tobytes())
    context.vertex_array(stone, corners, "in_position", "in_normal", "in_uv").render()
    context.vertex_array(paper, []).render(vertices=3)
    picture = context.simple_framebuffer(size, 3)
    context.copy_framebuffer(picture, target)
    return Image.frombytes("RGB", size, picture.read(alignment=1)).transpose(Image.Transpose.FLIP_TOP_BOTTOM)


def render(chosen: argparse.Namespace) -> None:
    """Read the files, draw the pictures and save them as one."""
    scene = load_scene(chosen.mesh)
    if scene.uvs is None:
        raise InputError(f"{chosen.mesh}: has no UVs; use the mesh that `aoprecalc bake` wrote")
    sets = [read_spheres(file) for file in chosen.spheres]
    normals = y_up(shading_normals(scene), chosen.up)
    mesh = np.concatenate([y_up(scene.corners, chosen.up), normals, scene.uvs], axis=2).reshape(-1, 8)
    width, height = chosen.size
    picture = Image.new("RGB", (width, height * len(sets)))
    with open_renderer() as renderer:
        for number, (centers, radii) in enumerate(sets):
            rows = np.column_stack([y_up(centers, chosen.up), radii])
            drawn = draw(renderer.context, mesh, read_image(chosen.texture), rows, (width, height))
            picture.paste(drawn, (0, number * height))
    if len(sets) > 1:
        font = ImageFont.load_default(size=22)
        for number, file in enumerate(chosen.spheres):
            ImageDraw.Draw(picture).text((24, number * height + 18), file.name, fill=(70, 74, 80), font=font)
    picture.save(chosen.output)


def main() -> None:
    """Render what the command line names."""
    parser = argparse.ArgumentParser(description="Render a mesh with its baked texture and its spheres' shadow.")
    parser.add_argument("mesh", type=Path, help="as written by `aoprecalc bake`, with UVs")
    parser.add_argument("texture", type=Path, help="its ambient-occlusion texture")
    parser.add_argument("spheres", type=Path, nargs="+", help="its sphere sets, as written by `aoprecalc spheres`")
    parser.add_argument("-o", "--output", type=Path, default=Path("picture.png"))
    parser.add_argument("--up", choices=("y", "z"), default="y", help="the mesh's upward axis (default: y)")
    parser.add_argument(
        "--size", type=int, nargs=2, default=(1280, 720), metavar=("WIDTH", "HEIGHT"), help="of each picture"
    )
    chosen = parser.parse_args()

    try:
        render(chosen)
    except AoprecalcError as error:
        parser.exit(error.exit_code, f"error: {error}\n")


if __name__ == "__main__":
    main()
