import struct
import time

import numpy as np
import pytest

from aoprecalc.errors import InputError, OutputError, UsageError
from aoprecalc.io import choose_bit_depth, read_image, write_image
from aoprecalc.io.images import BIT_DEPTHS, quantize, stored

RAMP = np.linspace(-0.2, 1.2, 600, dtype=np.float32).reshape(20, 30)
ALL = [(suffix, depth) for suffix, depths in BIT_DEPTHS.items() for depth in depths]
LEVELS = {"8": 255, "16": 65535}


@pytest.mark.parametrize(("suffix", "depth"), ALL)
def test_what_is_written_is_read_back(tmp_path, suffix, depth):
    path = tmp_path / f"a{suffix}"
    write_image(path, RAMP, depth)
    expected = quantize(RAMP, depth) / np.float64(LEVELS.get(depth, 1))
    assert read_image(path) == pytest.approx(expected, abs=1.5 / 255 if "jp" in suffix else 1e-7)
    if "jp" not in suffix:
        assert stored(RAMP, depth) == pytest.approx(read_image(path), abs=1e-7)


@pytest.mark.parametrize(("suffix", "depth"), ALL)
def test_bytes_are_the_same_each_time_and_hold_no_date(tmp_path, suffix, depth):
    for name in "ab":
        write_image(tmp_path / f"{name}{suffix}", RAMP, depth)
    data = (tmp_path / f"a{suffix}").read_bytes()
    assert data == (tmp_path / f"b{suffix}").read_bytes()
    assert time.strftime("%Y:%m:").encode() not in data


def test_rounding_is_to_the_nearest_and_saturates():
    values = np.array([[-1.0, 0.0, 0.49 / 255, 0.51 / 255, 0.5, 254.4 / 255, 254.6 / 255, 1.0, 7.0]], dtype=np.float32)
    assert quantize(values, "8").tolist() == [[0, 0, 0, 1, 128, 254, 255, 255, 255]]
    assert quantize(values, "8").dtype == np.uint8
    assert quantize(values[:, [0, 4, 7, 8]], "16").tolist() == [[0, 32768, 65535, 65535]]
    assert quantize(values, "half").dtype == np.float16
    assert np.array_equal(quantize(values, "float"), values)


def test_png_has_one_channel_and_no_word_about_colour(tmp_path):
    write_image(tmp_path / "a.png", RAMP, "16")
    data = (tmp_path / "a.png").read_bytes()
    width, height, bits, color = struct.unpack_from(">IIBB", data, 16)
    assert (width, height, bits, color) == (30, 20, 16, 0)
    for chunk in (b"sRGB", b"gAMA", b"iCCP", b"cICP", b"tIME"):
        assert chunk not in data


def test_row_0_is_the_upper_one(tmp_path):
    values = np.zeros((2, 3), dtype=np.float32)
    values[0] = 1
    write_image(tmp_path / "a.bmp", values)
    data = (tmp_path / "a.bmp").read_bytes()
    assert struct.unpack_from("<i", data, 22)[0] == 2  # a positive height: rows go from the bottom up
    assert data[-8:-5] == b"\0\0\0"
    assert data[-4:-1] == b"\xff\xff\xff"


def test_auto_depths():
    assert choose_bit_depth("a.png", "auto") == "8"
    assert choose_bit_depth("a.EXR", "auto") == "half"
    assert choose_bit_depth("a.tif", "auto") == "8"


@pytest.mark.parametrize(("name", "depth", "said"), [("a.png", "half", "8, 16"), ("a.exr", "8", "half, float")])
def test_an_impossible_depth_names_the_possible_ones(tmp_path, name, depth, said):
    with pytest.raises(UsageError, match=said):
        write_image(tmp_path / name, RAMP, depth)
    assert not list(tmp_path.iterdir())


def test_an_unknown_extension_names_the_known_ones():
    with pytest.raises(UsageError) as failure:
        choose_bit_depth("a.xyz", "auto")
    assert all(suffix in str(failure.value) for suffix in BIT_DEPTHS)


def test_failures_are_told_in_one_line(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        write_image(tmp_path / "none" / "a.png", RAMP)
    with pytest.raises(InputError, match="there is no such file"):
        read_image(tmp_path / "none.png")
    (tmp_path / "bad.png").write_bytes(b"not a picture")
    with pytest.raises(InputError, match="cannot be read as an image") as failure:
        read_image(tmp_path / "bad.png")
    assert "\n" not in str(failure.value)
