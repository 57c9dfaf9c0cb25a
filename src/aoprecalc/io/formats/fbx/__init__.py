"""FBX, binary and text, by ufbx."""

import re
from importlib.util import find_spec
from pathlib import Path

from aoprecalc.errors import InputError
from aoprecalc.io.formats.fbx.materials import picture_files
from aoprecalc.io.formats.fbx.reader import read_fbx
from aoprecalc.io.formats.library_process import LibraryProcess, answer_request
from aoprecalc.io.formats.materials import PicturedFormat
from aoprecalc.types import Scene

# Damage may crash ufbx, and its Python binding leaves memory in disorder, so that another process reads each file.
_UFBX = LibraryProcess("ufbx", __name__)
_START = re.compile(rb"Kaydara FBX Binary|\s*(;[^\r\n]*\s*)*FBXHeaderExtension")


class FbxFormat(PicturedFormat):
    """The meshes of a scene that are shown, with the pictures of their materials."""

    name = "FBX"
    extensions = (".fbx",)

    def sniff(self, data: bytes) -> bool:
        """Tell whether it begins as a binary FBX, or as text with a header of FBX."""
        return _START.match(data[:4096]) is not None

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the meshes where their nodes place them; raises InputError where ufbx is missing."""
        if find_spec("ufbx") is None:
            raise InputError(f"{path}: FBX needs the package ufbx; `pip install 'aoprecalc[fbx]'`")
        scene = _UFBX.work(path, len(data), (path, data))
        assert isinstance(scene, Scene)
        return scene

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the pictures that it names."""
        return picture_files(path, data)


def answer() -> None:
    """In the child: send the scene of a file back."""
    answer_request(lambda request: read_fbx(*request))
