"""What a sphere set is called where a format wants a name: as the file of its mesh is."""

import re

from aoprecalc.model import Scene


def printable(scene: Scene | None) -> str:
    """Return the stem of the scene's file; bytes that are no UTF-8 and control characters, which XML lacks, are _."""
    stem = scene.path.stem if scene is not None else ""
    return "".join(letter if letter.isprintable() else "_" for letter in stem) or "mesh"


def identifier(scene: Scene | None) -> str:
    """Return the same as an ASCII identifier: letters, digits and _, not a digit first."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", printable(scene))
    return f"_{name}" if name[0].isdigit() else name
