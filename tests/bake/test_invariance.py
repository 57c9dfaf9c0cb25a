"""What must not change a bake: where the mesh is, how large, how turned, mirrored, batched, or baked before."""

from contextlib import contextmanager

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.gl.context import open_renderer
from aoprecalc.mesh.surface import sample_surface
from aoprecalc.options import BakeOptions
from aoprecalc.raster import layout as raster_layout
from aoprecalc.texture_lookup import bilinear
from aoprecalc.visibility import backend, depth_maps, gather, plan
from shapes import ball, dented, join, quad, quad_uvs, rotation, scene, torus, triangle_a_cell

slow = pytest.mark.slow
OPTIONS = BakeOptions(width=96, height=96, directions=512, shadow_size=512)
SAMPLING_ERROR = 0.0075  # RMS between the pictures of two sets of 512 directions, as rendered


def still_life():
    """A ball over a floor, with UVs: the floor on the left, the ball's halves on the right."""
    positions, faces = ball(2, 0.5)
    positions = positions + (0.1, 0.2, 0.6)
    floor = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    ball_uvs = triangle_a_cell(len(faces)) * (0.5, 1) + (0.5, 0)
    return *join(floor, (positions, faces)), np.concatenate([quad_uvs((0, 0), (0.48, 1)), ball_uvs])


def bake(positions, faces, uvs, options=OPTIONS):
    return bake_scene(scene(positions, faces, uvs), options).texture


def rendered(texture):
    """What look-ups at points all over the surface find."""
    positions, faces, uvs = still_life()
    points = sample_surface(scene(positions, faces), np.ones(len(faces), bool), 10_000, seed=0)
    return bilinear(texture.values, points.interpolate(uvs), repeats=False)


@pytest.fixture(scope="module")
def baseline():
    return bake(*still_life())


@pytest.mark.parametrize(
    ("scale", "shift"),
    [
        (1e-4, 0.0),
        pytest.param(1e4, 0.0, marks=slow),
        (1.0, 1e4),
        pytest.param(1e-4, 1.0, marks=slow),
        pytest.param(1e4, 1e8, marks=slow),
    ],
    ids=str,
)
def test_scale_and_place_change_nothing(baseline, scale, shift):
    positions, faces, uvs = still_life()
    moved = bake(positions * scale + shift * np.array([1, -0.7, 0.4]), faces, uvs)
    assert (moved.valid == baseline.valid).all()
    assert np.abs(moved.values - baseline.values).max() < 0.02
    assert np.sqrt(np.mean((moved.values - baseline.values) ** 2)) < 0.001


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=slow) for seed in (1, 2))])
def test_turning_changes_nothing_beyond_sampling(baseline, seed):
    positions, faces, uvs = still_life()
    turned = bake(positions @ rotation(seed).T, faces, uvs)
    difference = rendered(turned) - rendered(baseline)
    assert np.sqrt(np.mean(difference**2)) < SAMPLING_ERROR
    assert abs(difference.mean()) < 0.001


def test_mirroring_changes_nothing_beyond_sampling(baseline):
    positions, faces, uvs = still_life()
    mirrored = bake(positions * (-1, 1, 1), faces[:, ::-1], uvs[:, ::-1])
    difference = rendered(mirrored) - rendered(baseline)
    assert (mirrored.valid == baseline.valid).mean() > 0.999
    assert np.sqrt(np.mean(difference**2)) < SAMPLING_ERROR


def test_the_same_bytes_run_after_run(baseline):
    again = bake(*still_life())
    assert again.values.tobytes() == baseline.values.tobytes()
    assert again.valid.tobytes() == baseline.valid.tobytes()


def test_batches_and_bands_change_no_bit(baseline, monkeypatch):
    monkeypatch.setattr(depth_maps, "_MAX_BATCH_BYTES", 1)  # one map at a time
    monkeypatch.setattr(raster_layout, "BAND_TEXELS", 7 * 96)
    assert bake(*still_life()).values.tobytes() == baseline.values.tobytes()


@pytest.mark.parametrize("kind", ["gl", "ray"])
def test_chunks_change_no_bit(kind, monkeypatch):
    """Of which the last is smaller, and whose texels lie in some bands only."""
    made = scene(*still_life())
    options = BakeOptions(size=96, directions=130, shadow_size=128, backend=kind)
    monkeypatch.setattr(plan, "FIT_CHUNK", 1000)
    monkeypatch.setattr(gather, "FIT_CHUNK", 1000)
    monkeypatch.setattr(raster_layout, "BAND_TEXELS", 20 * 96)
    pictures = []
    for parts in (100, 3, 1):
        monkeypatch.setattr(plan, "_MAX_FIT_CHUNKS", parts)
        pictures.append(bake_scene(made, options).texture.values.tobytes())
    assert pictures[0] == pictures[1] == pictures[2]


@slow
def test_runs_of_small_triangles_change_no_bit(monkeypatch):
    """Nor do batches where the limit of what is small lies amid the sizes of a mesh's triangles."""
    made = scene(*join(dented(3), quad((-2, -2, -1.2), (4, 0, 0), (0, 4, 0), cells=9)))
    options = BakeOptions(width=96, height=96, directions=130, shadow_size=128)
    whole = bake_scene(made, options).texture.values
    monkeypatch.setattr(depth_maps, "_MAX_SMALL_TRIANGLES", 64)
    assert bake_scene(made, options).texture.values.tobytes() == whole.tobytes()
    pictures = []
    for most_bytes in (1 << 25, 1):
        monkeypatch.setattr(depth_maps, "_SMALL", 7.0)
        monkeypatch.setattr(depth_maps, "_MAX_BATCH_BYTES", most_bytes)
        pictures.append(bake_scene(made, options).texture.values.tobytes())
    assert pictures[0] == pictures[1]


def test_looking_through_small_triangles_finds_what_a_rasteriser_finds(monkeypatch):
    """Both ways sample the same planes at the same centres; only the rounding of their depths is up to the renderer."""
    floor = quad((-2, -2, -1.2), (4, 0, 0), (0, 4, 0), cells=6)
    made = scene(*join(dented(3), floor))
    options = BakeOptions(width=96, height=96, directions=128, shadow_size=128)
    pictures = []
    for small in (0.0, 16.0, 1000.0):  # none, all but the floor, all
        monkeypatch.setattr(depth_maps, "_SMALL", small)
        pictures.append(bake_scene(made, options).texture.values)
    assert pictures[0].std() > 0.1
    assert np.abs(pictures[1] - pictures[0]).mean() < 1e-5
    assert np.abs(pictures[2] - pictures[0]).mean() < 1e-5


def test_more_directions_come_closer():
    positions, faces = torus()
    shape = scene(positions, faces)

    def picture(directions):
        return bake_scene(shape, BakeOptions(size=64, directions=directions, backend="ray")).texture

    truth = picture(2000)
    errors = [np.abs((picture(n).values - truth.values)[truth.valid]).mean() for n in (16, 64, 256)]
    assert errors[0] > 1.5 * errors[1]
    assert errors[1] > 1.5 * errors[2]


def test_nothing_is_left_on_the_renderer(monkeypatch):
    opened = []

    @contextmanager
    def watched(threads=0):
        with open_renderer(threads) as renderer:
            yield renderer
            assert renderer.context.error == "GL_NO_ERROR"
            opened.append(renderer.context)
        assert len(renderer.context.objects) == 0

    monkeypatch.setattr(backend, "open_renderer", watched)
    bake(*still_life())
    assert len(opened) == 1
