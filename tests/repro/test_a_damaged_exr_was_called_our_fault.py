"""OpenImageIO quotes bytes of a damaged EXR in its message; one that was no UTF-8 ended in a traceback."""

import numpy as np
import pytest

from aoprecalc.errors import InputError
from aoprecalc.io.images import read_pixels, read_text, write_image


@pytest.mark.parametrize("kind", [b"box2i", b"chlist"])
def test_a_message_that_is_no_text_is_left_out(kind, tmp_path):
    path = tmp_path / "a.exr"
    write_image(path, np.zeros((4, 4), np.float32))
    path.write_bytes(path.read_bytes().replace(kind, b"\xd8" + kind[1:], 1))
    with pytest.raises(InputError, match=r"cannot be read as an image \(it is damaged\)"):
        read_pixels(path)
    assert read_text(path) == ""
