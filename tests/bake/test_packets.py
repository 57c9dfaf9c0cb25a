"""Packets of rays see what single rays see, whatever counts as light and however they are packed."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from aoprecalc.progress import Progress
from aoprecalc.visibility import packets, ray_testers, rays
from aoprecalc.visibility.directions import light_axes
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.ray_testers import PacketTester, RayTester, _order_of_axes
from aoprecalc.visibility.rays import RayCaster
from aoprecalc.visibility.sky import OvercastSky
from bake.test_visibility import still

AXES = light_axes(200)


def sums(tester, samples, axes=AXES):
    return tester.accumulate(samples, axes, Progress())


def packed(surface, integrand, samples, *, of_samples, monkeypatch):
    """The sums by packets of samples, or of directions."""
    monkeypatch.setattr(packets, "_TEXELS_PER_TRIANGLE", 0.0 if of_samples else np.inf)
    return sums(PacketTester(surface, integrand, len(samples.faces)), samples)


UPWARDS = OvercastSky((0.0, 0.6, 0.8))
INTEGRANDS = {
    "cosine": Integrand(),
    "uniform weight": Integrand(weight="uniform"),
    "cone": Integrand(min_cosine=0.6),
    "near occluders": Integrand(max_distance=0.4),
    "sky and vectors": Integrand(sky=UPWARDS, vectors=True),
}


BOTH = pytest.mark.parametrize("of_samples", [True, False], ids=["of samples", "of directions"])


@BOTH
@pytest.mark.parametrize("name", INTEGRANDS)
def test_the_sums_are_those_of_single_rays_seed_3(name, of_samples, monkeypatch):
    surface, samples = still(3)
    single = sums(RayTester(surface, INTEGRANDS[name]), samples)
    assert 0.1 < single[:, 0].sum() / single[:, 1].sum() < 0.9
    fast = packed(surface, INTEGRANDS[name], samples, of_samples=of_samples, monkeypatch=monkeypatch)
    assert fast[:, 1] == pytest.approx(single[:, 1], rel=1e-5)
    # A ray that grazes an edge may be seen to hit it or not.
    assert np.quantile(np.abs(fast - single).max(axis=1), 0.99) < 1e-4


@BOTH
@pytest.mark.parametrize("max_distance", [np.inf, 0.4])
def test_so_they_are_on_and_below_a_ground_seed_3(max_distance, of_samples, monkeypatch):
    surface, samples = still(3)
    surface = replace(surface, ground_normal=(0.0, 0.6, 0.8), ground_height=-0.2, buried=True)
    integrand = Integrand(max_distance=max_distance)
    single = sums(RayTester(surface, integrand), samples)
    assert (single[:, 0] == 0).any()
    fast = packed(surface, integrand, samples, of_samples=of_samples, monkeypatch=monkeypatch)
    assert np.quantile(np.abs(fast - single).max(axis=1), 0.99) < 1e-4


@BOTH
@pytest.mark.parametrize("axes", [1, 16, 17])
def test_packets_that_are_not_full_see_no_more_seed_3(axes, of_samples, monkeypatch):
    surface, samples = still(3)
    some = samples.select(slice(0, 33))
    monkeypatch.setattr(packets, "_TEXELS_PER_TRIANGLE", 0.0 if of_samples else np.inf)
    single = sums(RayTester(surface, Integrand()), some, AXES[:axes])
    fast = sums(PacketTester(surface, Integrand(), len(samples.faces)), some, AXES[:axes])
    assert 0 < single[:, 0].sum() < single[:, 1].sum()
    assert fast == pytest.approx(single, abs=1e-5)


@BOTH
def test_threads_and_tasks_do_not_change_a_bit_seed_3(of_samples, monkeypatch):
    surface, samples = still(3)
    whole = packed(surface, Integrand(), samples, of_samples=of_samples, monkeypatch=monkeypatch)
    monkeypatch.setattr(packets, "_SAMPLES_PER_TASK", 48)
    tester = PacketTester(surface, Integrand(), len(samples.faces), threads=3)
    assert np.array_equal(sums(tester, samples), whole)


@pytest.mark.parametrize("samples_per_triangle", [0.5, 50])
def test_samples_in_parts_do_not_change_a_bit_seed_3(samples_per_triangle, monkeypatch):
    asked, made = [], packets.occluded_arguments
    monkeypatch.setattr(
        packets, "occluded_arguments", lambda *, coherent: asked.append(coherent) or made(coherent=coherent)
    )
    surface, samples = still(3)
    count = len(samples.faces)
    tester = PacketTester(surface, Integrand(), round(samples_per_triangle * len(surface.occluders)))
    parts = [slice(0, 33), slice(33, count // 2), slice(count // 2, count)]
    in_parts = np.concatenate([sums(tester, samples.select(part)) for part in parts])
    assert np.array_equal(in_parts, sums(tester, samples))
    assert set(asked) == {samples_per_triangle > 2}  # all of samples, or all of directions


def test_directions_done_are_counted_seed_3(monkeypatch):
    surface, samples = still(3)
    monkeypatch.setattr(packets, "_SAMPLES_PER_TASK", 16)
    counted = []

    class Counter(Progress):
        def advance(self, count=1):
            counted.append(count)

    PacketTester(surface, Integrand(), len(samples.faces), threads=2).accumulate(samples, AXES, Counter())
    assert sum(counted) == 2 * len(AXES)
    assert len(counted) > 10


@pytest.mark.parametrize("max_distance", [1e30, 2.0])
@pytest.mark.parametrize("parallel", [True, False])
def test_packets_of_any_rays_hit_what_single_rays_hit_seed_4(parallel, max_distance, monkeypatch):
    rng = np.random.default_rng(4)
    corners = rng.normal(size=(60, 1, 3)) + 0.3 * rng.normal(size=(60, 3, 3))
    origins = rng.normal(size=(1003, 3)).astype(np.float32)
    directions = rng.normal(size=(1 if parallel else 1003, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    caster = RayCaster(corners.astype(np.float32), threads=2)
    single = caster.occluded(origins, directions, max_distance)
    assert 0.1 < single.mean() < 0.9
    monkeypatch.setattr(rays, "_PACKED_RAYS", 0)
    monkeypatch.setattr(packets, "_RAYS_PER_TASK", 160)
    assert np.array_equal(caster.occluded(origins, directions, max_distance), single)


def test_code_that_has_no_file_is_compiled_all_the_same():
    """numba keeps compiled code beside the file of its source, or refuses to."""
    made = {"compiled": packets._compiled}
    exec("@compiled\ndef twice(number):\n    return 2 * number", made)
    assert made["twice"](21) == 42


def test_casting_takes_no_memory_beyond_the_sums_seed_3():
    surface, some = still(3)
    samples = some.select(np.arange(200_000) % len(some.faces))
    tester = PacketTester(surface, Integrand(), len(samples.faces), threads=1)
    sums(tester, samples, AXES[:1])  # compiles
    tracemalloc.start()
    try:
        sums(tester, samples, AXES[:1])
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 12 * len(samples.faces)  # two sums take eight bytes


def test_axes_that_follow_each_other_lie_near_each_other():
    many = light_axes(1152)
    order = _order_of_axes(many)
    assert sorted(order.tolist()) == list(range(len(many)))

    def way(axes):
        return np.arccos(np.minimum(np.abs((axes[1:] * axes[:-1]).sum(axis=1)), 1)).sum()

    assert way(many[order]) < 0.3 * way(many)


@BOTH
def test_the_order_of_axes_changes_no_sum_beyond_rounding_seed_3(of_samples, monkeypatch):
    surface, samples = still(3)
    found = packed(surface, Integrand(), samples, of_samples=of_samples, monkeypatch=monkeypatch)
    monkeypatch.setattr(ray_testers, "_order_of_axes", lambda axes: np.arange(len(axes))[::-1])
    other = packed(surface, Integrand(), samples, of_samples=of_samples, monkeypatch=monkeypatch)
    assert other[:, 1] == pytest.approx(found[:, 1], rel=1e-6)
    # A ray that grazes an edge may be seen to hit it or not by another packet.
    assert np.quantile(np.abs(other - found).max(axis=1), 0.99) < 1e-4
