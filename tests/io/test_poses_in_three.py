"""Poses of animated meshes as three.js has them, where node and what scripts/setup-viewer installs are there."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from aoprecalc.io.meshes import scene_in_pose
from gltf_kit.gltf_animated import box_with_lid, clip, floats, strip_over_a_joint, turn
from shapes import torus

ROOT = Path(__file__).parents[2]
THREE = ROOT / "viewer/node_modules/three"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("node") and THREE.is_dir()), reason="needs node, and three.js from scripts/setup-viewer"
    ),
]


def lid(gltf):
    box_with_lid(gltf, (10, 100))
    return "open"


def strip(gltf):
    strip_over_a_joint(gltf, 100)
    return "bend"


def all_at_once(gltf):
    """A ring with two joints per vertex and two morph targets, under nodes that move by every interpolation."""
    chance = np.random.default_rng(0)
    positions, faces = torus(around=12, across=6)
    count = len(positions)
    shares = floats(chance.random((count, 4)))
    shares /= shares.sum(axis=1, keepdims=True)
    attributes = {
        "POSITION": gltf.vertices(floats(positions), bounds=True),
        "JOINTS_0": gltf.vertices(chance.integers(0, 3, (count, 4)).astype("<u1")),
        "WEIGHTS_0": gltf.vertices(shares),
    }
    targets = [{"POSITION": gltf.vertices(floats(0.3 * chance.normal(size=(count, 3))), bounds=True)} for _ in "ab"]
    primitive = {"attributes": attributes, "targets": targets, "indices": gltf.indices(faces.astype("<u2"))}
    knee = gltf.node(translation=[0, 0, 0.4])
    hip = gltf.node(children=[knee], rotation=turn((0, 0.6, 0.8), 20))
    root = gltf.node(children=[hip], translation=[1, 2, 3])
    inverse = gltf.accessor(floats(np.tile(np.eye(4), (3, 1, 1)) + 0.1 * (np.arange(4) < 3)[:, None]).reshape(3, 16))
    gltf.add("skins", {"joints": [root, hip, knee], "inverseBindMatrices": inverse})
    shown = gltf.node(mesh=gltf.mesh(primitive, weights=[0.2, 0.4]), skin=0)
    plain = {"attributes": {"POSITION": attributes["POSITION"]}, "indices": primitive["indices"]}
    gltf.json["nodes"][hip]["children"].append(gltf.node(mesh=gltf.mesh(plain), scale=[1, -0.5, 1]))
    turns = chance.normal(size=(4, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    spline = 0.5 * chance.normal(size=(3, 3, 4))
    spline[:, 1] = turns[:3]
    clip(
        gltf,
        "all",
        (root, "translation", [0.2, 1, 2.5], chance.normal(size=(9, 3)), "CUBICSPLINE"),
        (root, "rotation", [0, 0.5, 1, 2], turns),
        (hip, "rotation", [0, 1, 3], spline.reshape(9, 4), "CUBICSPLINE"),
        (hip, "scale", [0, 1.5], [[1, 1, 1], [1, 2, 0.5]], "STEP"),
        (knee, "translation", [0, 3], [[0, 0, 0.4], [0.5, 0, 0]]),
        (shown, "weights", [0, 1, 2], [0, 1, 0.5, 0.5, 1, 0]),
    )
    return "all"


@pytest.mark.parametrize("made", [lid, strip, all_at_once], ids=["lid", "strip", "all at once"])
def test_corners_are_where_three_has_them(gltf, made):
    name = made(gltf)
    scene, end = gltf.load(), {"all": 3.0}.get(name, 1.0)
    times = [round(share * end, 3) for share in (0, 0.1, 0.37, 0.5, 0.81, 1)]
    poses = [word for time in times for word in (name, str(time))]
    command = ["node", ROOT / "tests/gltf_kit/posed.mjs", THREE, scene.path, *poses]
    answer = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120)
    for time, theirs in zip(times, json.loads(answer.stdout), strict=True):
        ours = scene_in_pose(scene, f"{name}@{time}").corners
        assert sorted_corners(ours) == pytest.approx(sorted_corners(np.reshape(theirs, (-1, 3, 3))), abs=1e-5), time


def sorted_corners(corners):
    """The coordinates of each triangle in ascending order: a mirrored part is wound the other way here."""
    return np.sort(np.asarray(corners), axis=1)
