"""What meshes say about the pictures that lie on them."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aoprecalc.files.images import decode_pixels, read_pixels
from aoprecalc.model import Doubles, Floats


@dataclass(frozen=True)
class Picture:
    """A picture that a mesh refers to.

    name   what messages call it
    path   its file; None where the mesh's own file holds it
    data   its bytes in that case
    """

    name: str
    path: Path | None = None
    data: bytes = field(default=b"", repr=False, compare=False)

    def pixels(self) -> Floats:
        """Return its values as stored, (height, width, channels) float32; raises InputError where it is unreadable."""
        return decode_pixels(self.data, self.name) if self.path is None else read_pixels(self.path)

    def read(self) -> Floats:
        """Return its first channel, (height, width) float32; raises InputError where it is unreadable."""
        return np.ascontiguousarray(self.pixels()[:, :, 0])


@dataclass(frozen=True, eq=False)
class Pictured:
    """The ambient occlusion on one part of a scene, as its file has it.

    picture   None where it names none
    uvs       (n, 3, 2) float64 at the part's corners, v upwards, those that the picture is for, or else the file's
              first; None where there are none
    note      what the user should know about it
    """

    picture: Picture | None
    uvs: Doubles | None
    note: str = ""
