"""FBX, binary and text, by ufbx."""

import os
import pickle
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.fbx.materials import picture_files
from aoprecalc.io.formats.fbx.reader import read_fbx
from aoprecalc.io.formats.materials import PicturedFormat
from aoprecalc.subprocesses import ChildTimeoutError, ask, end_with_parent
from aoprecalc.types import Scene

_CHILD = [sys.executable, "-P", "-c", "from aoprecalc.io.formats.fbx import answer; answer()"]
_SECONDS, _BYTES_PER_SECOND = 60.0, 1e6  # for which a child may read
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
        return _read_apart(path, data)

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the pictures that it names."""
        return picture_files(path, data)


# Damage may crash ufbx, and its Python binding leaves memory in disorder, so that another process reads each file.


def _read_apart(path: Path, data: bytes) -> Scene:
    seconds = round(_SECONDS + len(data) / _BYTES_PER_SECOND)
    try:
        found = pickle.loads(ask(_CHILD, pickle.dumps((path, data)), timeout=seconds))
    except ChildTimeoutError as error:
        raise damaged_file(path, f"ufbx gave {error}") from error
    except OSError as error:
        raise damaged_file(path, f"ufbx could not read it ({error})") from error
    if isinstance(found, AoprecalcError):
        raise found
    assert isinstance(found, Scene)
    return found


def answer() -> None:
    """In the child: send the scene of a file back, or an AoprecalcError, and end at once, without freeing memory."""
    end_with_parent()
    found: Scene | AoprecalcError
    try:
        with np.errstate(all="ignore"):
            found = read_fbx(*pickle.loads(sys.stdin.buffer.read()))
    except AoprecalcError as error:
        found = error
    except Exception as error:
        sys.exit(" ".join(str(error).split())[:120] or type(error).__name__)
    sys.stdout.buffer.write(pickle.dumps(found))
    sys.stdout.buffer.flush()
    os._exit(0)
