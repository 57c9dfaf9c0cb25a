"""The packed geometry of the 3D view: what the browser unpacks is the mesh, simplified without harm to seams."""

import base64
import json
import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from aoprecalc.mesh.surface import shading_normals
from aoprecalc.options import PreviewOptions
from aoprecalc.render import preview, shading
from aoprecalc.render import view_geometry as module
from aoprecalc.render.camera import view_axes
from aoprecalc.render.simplification import NotSimplifiedError
from aoprecalc.render.view_geometry import view_geometry, viewer_script
from aoprecalc.types import AlphaMask, BaseColor, Material, TexturedMesh
from shapes import ball, box, quad, quad_uvs, scene, scene_of_parts

VIEWER = Path(module.__file__).parent / "viewer"


def textured(mesh, uvs, base_colors=(), covered=None):
    faces = len(mesh.faces)
    normals = shading_normals(mesh).astype(np.float64)
    covered = np.ones(faces, bool) if covered is None else covered
    return TexturedMesh(mesh, normals, uvs, np.ones((4, 4), np.float32), covered, base_colors)


def plane(cells):
    """A square with v along y, and the UVs that are its own x and y."""
    return textured(scene(*quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells)), quad_uvs((0, 0), (1, 1), cells))


def globe(around, rings, offset=(0.0, 0.0, 0.0)):
    """A unit sphere by longitude and latitude, cut open along u = 0."""
    u, v = np.meshgrid(np.linspace(0, 1, around + 1), np.linspace(0, 1, rings + 1), indexing="ij")
    theta, phi = np.pi * v.ravel(), 2 * np.pi * (u.ravel() % 1)
    points = np.stack([np.sin(theta) * np.cos(phi), -np.cos(theta), np.sin(theta) * np.sin(phi)], axis=1)
    points, of_grid = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    corner = np.arange((around + 1) * (rings + 1)).reshape(around + 1, rings + 1)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    grid = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    faces = of_grid[grid]
    real = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    uvs = np.stack([u.ravel(), v.ravel()], axis=1)[grid[real]]
    return textured(scene(points + offset, faces[real]), uvs)


def unpacked(document):
    """A slow reading of the packed bytes: triangles, and columns by their names."""
    data = zlib.decompress(base64.b64decode(document["data"]))
    corners, count = 3 * document["triangles"], document["vertices"]
    codes = [data[i] + (data[i + corners] << 8) + (data[i + 2 * corners] << 16) for i in range(corners)]
    triangles, unused = [], 0
    for code in codes:
        triangles.append(unused - code)
        unused += code == 0
    columns, start = {}, 3 * corners
    for column in document["columns"]:
        value, numbers = 0, []
        for i in range(start, start + count):
            code = data[i] + (data[i + count] << 8)
            value = (value + (-(code + 1) // 2 if code & 1 else code // 2)) % 65536
            numbers.append(column["lower"] + column["step"] * value)
        columns[column["name"]] = np.array(numbers)
        start += 2 * count
    assert start == len(data)
    return np.array(triangles).reshape(-1, 3), columns


def same_triangles(all_uvs, uvs):
    """For each of the second triangles in UV space, which of the first it is; both may start at another corner."""
    distances, same = cKDTree(all_uvs.mean(axis=1)).query(uvs.mean(axis=1))
    assert distances.max() < 1 / 4096
    assert len(np.unique(same)) == len(uvs)
    turns = [np.abs(np.roll(all_uvs[same], -turn, axis=1) - uvs).max(axis=(1, 2)) for turn in range(3)]
    return same[:, None], (np.argmin(turns, axis=0)[:, None] + np.arange(3)) % 3


def positions_of(columns):
    return np.stack([columns[name] for name in "xyz"], axis=1)


def normals_of(columns):
    u, v = columns["nu"], columns["nv"]
    z = 1 - np.abs(u) - np.abs(v)
    fold = np.maximum(-z, 0)
    normals = np.stack([u - np.sign(u) * fold, v - np.sign(v) * fold, z], axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_a_small_mesh_is_kept_as_it_is():
    mesh = globe(24, 12)
    view = view_geometry(mesh, 10_000)
    triangles, columns = unpacked(json.loads(json.dumps(view.as_json())))
    assert view.total_triangles == len(triangles) == len(mesh.scene.faces)
    corners = view.center + view.scale * positions_of(columns)[triangles]
    uvs = np.stack([columns["u"], columns["v"]], axis=1)[triangles]
    same = same_triangles(mesh.uvs, uvs)
    np.testing.assert_allclose(uvs, mesh.uvs[same], atol=0.51 / 4096)
    np.testing.assert_allclose(corners, mesh.scene.corners[same], atol=2.02 / 2 / 8192)
    cosines = (normals_of(columns)[triangles] * mesh.normals[same]).sum(axis=-1)
    assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).max() < 0.4


def test_triangles_face_where_their_normals_point():
    positions, faces = ball(2)
    turned = scene(positions, faces[:, ::-1])
    normals = positions[turned.faces]  # of a unit sphere, outwards
    view = view_geometry(TexturedMesh(turned, normals, None, None, np.zeros(len(turned.faces), bool)), 1000)
    triangles, columns = unpacked(view.as_json())
    a, b, c = positions_of(columns)[triangles].swapaxes(0, 1)
    assert (np.einsum("tx,tx->t", np.cross(b - a, c - a), a + b + c) > 0).all()


def test_corners_share_a_vertex_unless_a_seam_parts_them():
    view = view_geometry(globe(24, 12), 10_000)
    assert len(view.columns[0].values) == 25 * 11 + 2 * 24  # the poles have a UV for each of their triangles


@pytest.mark.skipif(shutil.which("node") is None, reason="node is missing")
def test_the_script_of_the_page_reads_the_same_numbers():
    document = view_geometry(globe(24, 12), 300).as_json()
    source = (VIEWER / "packed_mesh.js").read_text(encoding="utf-8")
    script = f"""
        const THREE = {{}};
        {source}
        AoView.unpacked({json.dumps(document)}).then(({{ index, columns }}) => {{
            for (const name in columns) columns[name] = Array.from(columns[name]);
            console.log(JSON.stringify({{ index: Array.from(index), columns }}));
        }});"""
    done = subprocess.run(["node"], input=script, capture_output=True, text=True, check=True)
    read = json.loads(done.stdout)
    triangles, columns = unpacked(document)
    assert read["index"] == triangles.reshape(-1).tolist()
    assert read["columns"].keys() == columns.keys()
    for name, numbers in columns.items():
        np.testing.assert_allclose(read["columns"][name], numbers, atol=1e-6)


def test_a_plane_stays_flat_and_its_texture_in_place():
    mesh = plane(60)
    view = view_geometry(mesh, 500)
    triangles, columns = unpacked(view.as_json())
    assert len(triangles) <= 500 < view.total_triangles == 7200
    points = view.center + view.scale * positions_of(columns)
    assert np.abs(points[:, 2]).max() < 1e-9
    np.testing.assert_allclose(points[:, :2], np.stack([columns["u"], columns["v"]], axis=1), atol=3e-4)
    a, b, c = points[triangles].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(1, abs=1e-3)


def test_a_sphere_stays_round_and_no_triangle_crosses_its_seam():
    mesh = globe(96, 48)
    view = view_geometry(mesh, 1500)
    triangles, columns = unpacked(view.as_json())
    assert len(triangles) <= 1500 < view.total_triangles
    points = view.center + view.scale * positions_of(columns)
    assert np.abs(np.linalg.norm(points, axis=1) - 1).max() < 0.02
    assert np.linalg.norm(points[triangles].mean(axis=1), axis=1).min() > 0.97
    u = columns["u"][triangles]
    assert np.ptp(u, axis=1).max() < 0.5
    away = np.hypot(points[:, 0], points[:, 2]) > 0.3  # from the poles
    longitude = np.arctan2(points[:, 2], points[:, 0]) / (2 * np.pi)
    slip = (columns["u"] - longitude + 0.5) % 1 - 0.5
    assert np.abs(slip[away]).max() < 0.01
    np.testing.assert_allclose((normals_of(columns) * points).sum(axis=1), 1, atol=0.03)


def test_hard_edges_survive():
    corners, faces = zip(*(quad(*side, cells=20) for side in SIDES), strict=True)
    mesh = scene(np.concatenate(corners), np.concatenate([f + 441 * i for i, f in enumerate(faces)]))
    normals = np.repeat(np.array([np.cross(side[1], side[2]) for side in SIDES], float), 800 * 3, axis=0)
    view = view_geometry(TexturedMesh(mesh, normals.reshape(-1, 3, 3), None, None, np.zeros(4800, bool)), 200)
    triangles, columns = unpacked(view.as_json())
    assert len(triangles) <= 200
    of_corners = normals_of(columns)[triangles]
    np.testing.assert_allclose(of_corners, of_corners[:, :1].repeat(3, axis=1), atol=1e-9)
    points = positions_of(columns)[triangles]
    flat = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose((flat * of_corners[:, 0]).sum(axis=1), 1, atol=1e-3)


SIDES = [
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
]


def test_the_same_mesh_gives_the_same_bytes_wherever_it_is():
    packed = view_geometry(globe(96, 48), 1500).packed
    assert view_geometry(globe(96, 48), 1500).packed == packed
    far = view_geometry(globe(96, 48, offset=(2.0**20, 0, 0)), 10_000)
    near = view_geometry(globe(96, 48), 10_000)
    np.testing.assert_array_equal(far.triangles, near.triangles)
    for one, other in zip(far.columns[:3], near.columns[:3], strict=True):
        np.testing.assert_allclose(one.decoded(), other.decoded(), atol=1e-6 + one.step)


def test_base_colors_and_what_the_texture_leaves_open():
    mesh = scene_of_parts(box(), ball(1), box((2, 2, 2), (3, 3, 3)), ball(0))
    picture = np.zeros((600, 300, 3), np.uint8)
    random = np.random.default_rng(1)
    uvs = [random.uniform(0, 3, (part.stop - part.start, 3, 2)) for part in mesh.parts]
    colors = (
        BaseColor((1, 0, 0), picture, uvs[0]),
        BaseColor((0, 1, 0)),
        BaseColor((1, 0, 0), picture, uvs[2]),
        BaseColor((0, 1, 0)),
    )
    covered = mesh.per_face([True, True, True, False])
    view = view_geometry(textured(mesh, None, colors, covered), 10_000)
    kinds = {(kind.textured, kind.color, kind.texture) for kind in view.surfaces}
    assert kinds == {(True, (1, 0, 0), 0), (True, (0, 1, 0), None), (False, (0, 1, 0), None)}
    (reduced,) = view.base_textures
    assert (reduced.shape, reduced.dtype) == ((512, 256, 3), np.uint8)
    triangles, columns = unpacked(view.as_json())
    texture = np.array([-1 if view.surfaces[i].texture is None else 0 for i in columns["surface"].astype(int)])
    assert (np.diff(texture[triangles[:, 0]]) >= 0).all()
    assert (texture[triangles] == texture[triangles[:, :1]]).all()
    with_texture = texture[triangles[:, 0]] == 0
    found = np.stack([columns["u1"], columns["v1"]], axis=1)[triangles[with_texture]]
    expected = np.concatenate([uvs[0], uvs[2]])
    np.testing.assert_allclose(found, expected[same_triangles(expected, found)], atol=0.51 / 4096)


def test_a_mesh_that_stays_large_has_no_view():
    apart = [quad((3 * i, 0, 0), (1, 0, 0), (0, 1, 0)) for i in range(400)]
    mesh = scene_of_parts(*apart)
    with pytest.raises(NotSimplifiedError, match="too many small pieces"):
        view_geometry(textured(mesh, None), 50)


def leaf(cells=1):
    """A square with v along y whose texture is its place, with a round leaf in it, beside one without a mask."""
    corners, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0), cells)
    whole = quad((2, 0, 0), (1, 0, 0), (0, 1, 0))
    uvs = np.concatenate([quad_uvs((0, 0), (1, 1), cells), quad_uvs((2, 0), (3, 1))])
    made = scene_of_parts((corners, faces), whole)
    at = (np.arange(64) + 0.5) / 64 - 0.5
    alpha = np.clip((0.4 - np.hypot(*np.meshgrid(at, at))) * 32 + 0.5, 0, 1).astype(np.float32)
    mask = AlphaMask(alpha, uvs[: len(faces)], np.ones((len(faces), 3)), 0.5)
    pierced = replace(made.parts[0], material=Material(alpha_mask=mask), occludes=False)
    return textured(replace(made, parts=(pierced, made.parts[1])), uvs)


def area_of(view):
    triangles, columns = unpacked(view.as_json())
    a, b, c = positions_of(columns)[triangles].transpose(1, 0, 2) * view.scale
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_holes_of_alpha_masks_are_cut_out_with_their_textures_in_place():
    mesh = leaf()
    view = view_geometry(mesh, 400)
    triangles, columns = unpacked(view.as_json())
    assert 4 < len(triangles) <= 400
    assert area_of(view) == pytest.approx(1 + np.pi * 0.4**2, rel=0.01)
    points = view.center + view.scale * positions_of(columns)
    np.testing.assert_allclose(points[:, :2], np.stack([columns["u"], columns["v"]], axis=1), atol=4e-4)
    outside = points[:, 0] < 1.5
    assert np.hypot(points[outside, 0] - 0.5, points[outside, 1] - 0.5).max() < 0.45
    coarse = view_geometry(mesh, 12)
    assert 4 < len(coarse.triangles) <= 12
    assert area_of(coarse) == pytest.approx(1 + np.pi * 0.4**2, rel=0.1)


def test_with_too_many_masked_faces_their_holes_stay():
    view = view_geometry(leaf(cells=10), 350)
    assert len(view.triangles) == view.total_triangles == 202
    assert area_of(view) == pytest.approx(2, rel=1e-3)


def test_spheres_are_in_the_frame_of_the_mesh():
    view = view_geometry(plane(4), 100)
    centers, radii = np.array([[0.5, 0.5, 0], [0, 0, 1]]), np.array([0.25, 1])
    read = np.frombuffer(base64.b64decode(view.pack_spheres(centers, radii)), "<f4").reshape(-1, 4)
    np.testing.assert_allclose(read[:, :3] * view.scale + view.center, centers, atol=1e-6)
    np.testing.assert_allclose(read[:, 3] * view.scale, radii, atol=1e-6)


def test_one_triangle_and_a_mesh_without_extent_along_an_axis():
    view = view_geometry(textured(scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), None), 10)
    triangles, columns = unpacked(view.as_json())
    np.testing.assert_allclose(
        view.center + view.scale * positions_of(columns)[triangles[0]], [[0, 0, 0], [1, 0, 0], [0, 1, 0]], atol=2e-5
    )


def test_the_script_has_three_js_first_or_is_missing(monkeypatch, tmp_path):
    for name in module._SCRIPTS[1:]:
        (tmp_path / name).write_text(f"// {name}")
    monkeypatch.setattr(module, "_FOLDER", tmp_path)
    assert viewer_script() is None
    (tmp_path / "three.min.js").write_text("var THREE;")
    assert viewer_script().splitlines() == ["var THREE;", *(f"// {name}" for name in module._SCRIPTS[1:])]


def test_the_view_has_the_light_and_the_camera_of_the_still_pictures():
    surfaces, view = ((VIEWER / name).read_text(encoding="utf-8") for name in ("surfaces.js", "mesh_view.js"))
    for name in ("CLAY", "SPHERE", "INSIDE", "SKY", "BOUNCE", "KEY"):
        (numbers,) = re.findall(rf"\b{name} = (?:vec3\(|\[)([^)\]]*)", surfaces)
        np.testing.assert_allclose([float(number) for number in numbers.split(",")], getattr(shading, name), atol=1e-6)
    assert float(re.search(r"WHITE = ([\d.]+)", surfaces)[1]) == pytest.approx(float(shading.WHITE))
    light = preview._light(azimuth=0, ground=False)
    assert float(re.search(r"WRAP = ([\d.]+)", surfaces)[1]) == pytest.approx(np.sin(light.radius), abs=1e-3)
    turn, rise = re.search(r"KEY_LIGHT = { turn: (-?\d+), rise: (\d+) }", view).groups()
    np.testing.assert_allclose(view_axes(float(turn), float(rise))[2], light.direction)
    assert (PreviewOptions().azimuth, PreviewOptions().elevation) == tuple(
        float(angle) for angle in re.search(r"START = { azimuth: (\d+), elevation: (\d+)", view).groups()
    )


def test_every_script_is_part_of_the_page():
    assert {path.name for path in VIEWER.glob("*.js")} | {"three.min.js"} == set(module._SCRIPTS)


def test_the_bundle_has_what_the_scripts_use_of_three_js():
    source = Path(__file__).parents[2] / "viewer" / "three.js"
    exported = set(re.findall(r"^  (\w+),$", source.read_text(encoding="utf-8"), re.MULTILINE))
    scripts = [(VIEWER / name).read_text(encoding="utf-8") for name in module._SCRIPTS[1:]]
    assert exported == set(re.findall(r"\bTHREE\.([A-Z]\w+)", "".join(scripts)))
