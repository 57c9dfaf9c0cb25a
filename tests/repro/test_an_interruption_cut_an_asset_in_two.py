"""A batch interrupted while a result went to its place called the asset stopped, or left half of its files there."""

import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from aoprecalc import SphereOptions, batch
from aoprecalc.pipeline.run import defer_interrupts
from aoprecalc.pipeline.state import StateFolder
from shapes import box

SMALL = SphereOptions(8, samples=500)


def write_boxes(folder):
    positions, faces = box()
    lines = [f"v {x} {y} {z}" for x, y, z in positions] + ["f {} {} {}".format(*face) for face in faces + 1]
    folder.mkdir()
    for name in ("a.obj", "b.obj"):
        (folder / name).write_text("\n".join(lines) + "\n")


@pytest.fixture(params=[signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def number(request):
    """A signal that raises KeyboardInterrupt, as both do in the command."""
    before = signal.signal(request.param, signal.default_int_handler)
    yield request.param
    signal.signal(request.param, before)


@pytest.mark.parametrize("when", ["before", "after"])
def test_what_is_at_its_place_is_in_the_report(when, number, tmp_path, monkeypatch):
    write_boxes(tmp_path / "in")
    put = StateFolder.put

    def interrupted(self, name, record):
        if when == "before":
            signal.raise_signal(number)
        put(self, name, record)
        if when == "after":
            signal.raise_signal(number)

    with monkeypatch.context() as patch:
        patch.setattr(StateFolder, "put", interrupted)
        result = batch(tmp_path / "in", tmp_path / "out", spheres=SMALL)
    assert result.interrupted
    assert sorted(entry.status for entry in result.results) == ["made", "stopped"]
    again = batch(tmp_path / "in", tmp_path / "out", spheres=SMALL)
    assert sorted(entry.status for entry in again.results) == ["made", "unchanged"]


def interrupted(number, then):
    with defer_interrupts():
        signal.raise_signal(number)
        then()


def test_it_takes_effect_at_the_end_of_the_block(number):
    came_to = []
    with pytest.raises(KeyboardInterrupt):
        interrupted(number, lambda: came_to.append("the end"))
    assert came_to == ["the end"]
    assert signal.getsignal(number) is signal.default_int_handler


def test_an_error_of_the_block_stays_in_sight(number):
    with pytest.raises(KeyboardInterrupt) as caught:
        interrupted(number, lambda: int("of the block"))
    assert isinstance(caught.value.__context__, ValueError)


def test_nothing_is_held_back_outside_the_main_thread(number):
    def handler():
        with defer_interrupts():
            return signal.getsignal(number)

    assert handler() is not signal.default_int_handler
    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(handler).result() is signal.default_int_handler
    assert signal.getsignal(number) is signal.default_int_handler
