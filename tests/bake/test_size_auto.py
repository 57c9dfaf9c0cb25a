"""`size="auto"`: the smallest power of two that holds a density, or whose estimated error is small enough."""

import math

import numpy as np
import pytest

from aoprecalc.api.bake_scene import bake_scene
from aoprecalc.api.texture_size import DEFAULT_ERROR, SIZES, smallest_size
from aoprecalc.errors import ArgumentError, RendererError
from aoprecalc.io.outputs import read_json_object
from aoprecalc.options import BakeOptions
from aoprecalc.options.fields import as_words
from aoprecalc.uv.checks import TexelDensity
from shapes import box, join, notch, quad, quad_uvs, scene, torus

SQUARE = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))


def bake(made, **options):
    return bake_scene(made, BakeOptions(**{"size": "auto", "directions": 2, "backend": "ray", **options}))


def side(baked):
    height, width = baked.texture.values.shape
    assert height == width
    return width


# By density.


@pytest.mark.parametrize(
    ("density", "size"),
    [(1, 64), (62, 64), (63, 128), (100, 128), (126, 128), (127, 256), (200, 256)],  # gutters of 2 at the narrowest
)
def test_a_unit_square_gets_the_smallest_size_with_room_for_it_and_a_gutter(density, size):
    baked = bake(scene(*SQUARE), texel_density=density)
    assert side(baked) == size
    assert np.count_nonzero(baked.texture.valid) == density**2


def test_a_cube_of_edge_2_and_that_size_grows_with_density():
    made, sizes = scene(*box()), []
    for density in (5, 20, 40):
        baked = bake(made, texel_density=density)
        assert TexelDensity.of(made, baked.atlas, side(baked), side(baked)).least == pytest.approx(density)
        sizes.append(side(baked))
    assert sizes == [64, 128, 256]  # 6 squares of twice the density: 2 x 3, with gutters


def test_it_is_the_same_to_the_byte_as_with_the_number():
    made = scene(*join(torus(around=24, across=12), (box()[0] * 0.3 + 3, box()[1])))
    chosen = bake(made, texel_density=12.0, directions=16)
    given = bake(made, texel_density=12.0, directions=16, size=side(chosen))
    assert np.array_equal(chosen.texture.values, given.texture.values)
    assert np.array_equal(chosen.atlas.uvs, given.atlas.uvs)


@pytest.mark.parametrize(("density", "size"), [(10, 64), (32, 64), (33, 128), (64, 128), (64.1, 256)])
def test_uvs_that_are_kept_get_the_smallest_size_that_is_dense_enough(density, size):
    made = scene(*SQUARE, quad_uvs((0.25, 0.25), (0.75, 0.75)))
    baked = bake(made, texel_density=density)
    assert (baked.atlas.method, side(baked)) == ("keep", size)


def test_a_density_beyond_the_largest_size_is_refused(monkeypatch):
    monkeypatch.setattr("aoprecalc.api.texture_size.SIZES", (64, 128))
    with pytest.raises(ArgumentError, match=r"128 x 128 texels have no room; use 1\d\d, or a size of 256"):
        bake(scene(*SQUARE), texel_density=200)
    with pytest.raises(ArgumentError) as error:
        bake(scene(*SQUARE, quad_uvs((0, 0), (1, 1))), texel_density=200)
    assert str(error.value) == (
        "texel_density is 200, but the file's own UVs have 128 at 128 x 128, the largest size; use a lower one, "
        "or unwrap xatlas for new UVs"
    )


# By error.


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    """As many as are enough to see which of two sizes is better."""
    monkeypatch.setattr("aoprecalc.metrics.resolution.POINTS", 200)


@pytest.mark.parametrize("target", [0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0001, 0.0])
@pytest.mark.parametrize("power", [0.5, 1.0, 1.5])
def test_the_search_finds_the_smallest_size_with_few_tries(target, power):
    def error_at(size):
        asked.append(size)
        return (4 / size) ** power if size >= 128 else math.inf  # no room at 64

    asked, sizes = [], list(SIZES)
    size, errors = smallest_size(sizes, error_at, target)
    expected = next((size for size in sizes if error_at(size) <= target), sizes[-1])
    assert size == expected
    assert len(errors) <= 5
    assert len(asked[: len(errors)]) == len(set(asked[: len(errors)]))


def test_an_open_surface_needs_no_texels_and_one_size_alone_is_taken():
    assert side(bake(scene(*SQUARE))) == SIZES[0]
    assert smallest_size([256], lambda _: 1.0, 0.1) == (256, {256: 1.0})


@pytest.fixture(scope="module")
def step():
    """A notch, and a floor that a wall stands on: edges with steps and bends of the light."""
    return scene(
        *join(notch(60, 2.0), quad((3, 0, 0), (2, 0, 0), (0, 2, 0), 4), quad((4, 0, -1), (0, 2, 0), (0, 0, 2)))
    )


@pytest.mark.parametrize("target", [0.1, 0.012])
def test_the_error_is_shared_with_that_of_sampling(step, target):
    baked = bake(step, target_error=target, directions=2048)
    estimates = dict(baked.size_estimates)
    error = estimates[side(baked)]
    assert error <= target / math.sqrt(2)
    assert side(baked) == SIZES[0] or estimates[side(baked) // 2] > target / math.sqrt(2)
    assert baked.sampling_error**2 + error**2 <= target**2
    assert not any("estimated" in line for line in baked.warnings)


def test_a_target_beyond_the_largest_size_is_told(step, monkeypatch):
    monkeypatch.setattr("aoprecalc.api.texture_size.SIZES", (64, 128))
    baked = bake(step, target_error=0.001, directions=64)
    assert side(baked) == 128
    assert any(line.startswith("size 128: the resolution adds an estimated error of 0.0") for line in baked.warnings)


def test_the_report_and_the_command_line_tell_what_was_chosen(step, tmp_path, command):
    from aoprecalc.api.bake import bake as bake_mesh
    from aoprecalc.api.mesh import Mesh

    bake_mesh(Mesh(step.positions, step.faces), BakeOptions(size=64, directions=2)).save(tmp_path / "step.glb")
    done = command("bake", tmp_path / "step.glb", "--size", "auto", "-n", 64, "--unwrap", "xatlas", "--backend", "ray",
                   "-o", tmp_path / "out.png", "--report", tmp_path / "out.json")  # fmt: skip
    assert done.returncode == 0
    report = read_json_object(tmp_path / "out.json")
    choice, size = report["size_choice"], report["texels"]["width"]
    assert f"size {size}: the resolution adds an estimated error of {choice['error']:.4f}" in done.stderr
    assert choice["target"] == DEFAULT_ERROR
    assert choice["error"] <= DEFAULT_ERROR
    assert choice["error"] == next(entry["error"] for entry in choice["tried"] if entry["size"] == size)
    assert report["texels"]["height"] == size


def test_without_ray_tracing_errors_cannot_be_estimated_but_a_density_can_be_had(monkeypatch):
    monkeypatch.setattr("aoprecalc.api.texture_size.embreex_problem", lambda: "no embreex")
    with pytest.raises(RendererError, match="compares with ray tracing: no embreex; or use a number, or texel_density"):
        bake(scene(*SQUARE))
    assert side(bake(scene(*SQUARE), texel_density=10)) == 64


# As an option.


def test_it_is_an_option_everywhere(tmp_path):
    options = BakeOptions(size="auto")
    assert (options.size, options.width, options.height) == ("auto", 0, 0)
    assert as_words(options) == ["--size", "auto"]
    assert BakeOptions(size=512).size == (512, 512)
    for wrong in (0, "automatic", "auto "):
        with pytest.raises(ArgumentError, match=r"size is .*; expected a whole number from 1 to 32768, or a width and"):
            BakeOptions(size=wrong)
    with pytest.raises(ArgumentError, match="height is 0; expected a whole number from 1 to 32768"):
        BakeOptions(height=0)


@pytest.mark.parametrize("more", [{}, {"directions": None}, {"directions": None, "bent_normals": True}])
def test_a_size_that_is_chosen_has_room_for_all_that_the_bake_needs(more, monkeypatch):
    """Also for what neighbours share, and for vectors. More texels are always better here, and all are covered."""
    monkeypatch.setattr("aoprecalc.visibility.plan.resident_memory", lambda: 100 << 20)
    monkeypatch.setattr("aoprecalc.api.texture_size.resolution_error", lambda *_: 1.0)
    made, refused = scene(*SQUARE, quad_uvs((0, 0), (1, 1))), 0
    for limit in range(185, 225, 5):
        options = {"memory_limit": limit << 20, "shadow_size": 16, **more}
        size = side(bake(made, **options))
        with pytest.raises(ArgumentError, match="memory_limit"):
            bake(made, size=2 * size, **options)
        refused += size
    assert refused


def test_a_memory_limit_bounds_it(step, monkeypatch):
    monkeypatch.setattr("aoprecalc.visibility.plan.resident_memory", lambda: 100 << 20)
    most = bake(step, target_error=0.0, memory_limit=450 << 20)
    assert SIZES[0] < side(most) <= 1024
