"""What a probe says of the ways to an OpenGL context, and that a bake goes the same ones."""

import json
import subprocess
import sys

import pytest

from aoprecalc.api.checks import explain, is_software, probe
from aoprecalc.gl import context
from aoprecalc.gl.context import count_devices


def test_every_device_that_is_counted_can_be_asked_for_and_the_next_cannot():
    beyond = context.Candidate("egl", count_devices())
    with pytest.raises(Exception, match=f"found {beyond.device} devices"):
        context.make_context(beyond)
    if beyond.device:
        last = probe(["egl", str(beyond.device - 1)])
        assert "found" not in last.get("fault", "")


def test_the_first_device_that_works_is_the_one_that_is_opened():
    answers = (probe(["egl", str(device)]) for device in range(count_devices()))
    works = next(answer for answer in answers if "fault" not in answer)
    with context.open_renderer() as renderer:
        assert renderer.kind == "egl"
        assert works["renderer"] == renderer.name
        assert works["max_texture_size"] == renderer.context.info["GL_MAX_TEXTURE_SIZE"]


def test_candidates_are_tried_in_their_order_and_none_after_the_first_that_works(monkeypatch):
    tried = []

    def make(candidate):
        tried.append(candidate)
        if candidate.name != "EGL device 2":
            raise Exception("eglInitialize failed (0x3001)")
        return "a context"

    monkeypatch.setattr(context, "make_context", make)
    assert context._create() == ("a context", "egl")
    assert tried == list(context.CANDIDATES[:3])


def test_without_more_devices_osmesa_is_next(monkeypatch):
    tried = []

    def make(candidate):
        tried.append(candidate.name)
        if candidate.kind == "egl":
            raise Exception(f"requested device index {candidate.device}, but found 1 devices")
        return "a context"

    monkeypatch.setattr(context, "make_context", make)
    assert context._create() == ("a context", "osmesa")
    assert tried == ["EGL device 0", "OSMesa"]


def test_it_answers_in_json_by_itself():
    command = [sys.executable, "-P", "-m", "aoprecalc.api.checks", "egl", "15"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "requested device index 15" in json.loads(done.stdout)["fault"]


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        ("requested device index 0, but found 0 devices", "EGL has no driver (requested"),
        ("requested device index 3, but found 1 devices", "requested"),
        ("eglCreateContext failed (0x3009)", "it has no OpenGL 4.3 (eglCreate"),
        ("libEGL.so.1: cannot open shared object file", "EGL is not installed (libEGL"),
        ("libOSMesa is not installed", "libOSMesa is not installed"),
    ],
)
def test_reasons_are_explained(reason, expected):
    assert explain(reason).startswith(expected)
    assert reason in explain(reason)


@pytest.mark.parametrize(
    ("name", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("NVIDIA H100 80GB HBM3/PCIe/SSE2", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
        ("AMD Radeon RX 6600 (navi23, LLVM 15.0.6, DRM 3.49)", False),
    ],
)
def test_software_is_told_from_hardware_by_name(name, software):
    assert is_software(name) == software
