"""A USD stage: what is kept of it, its files and messages, and the process in which USD works on it."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from aoprecalc.io.formats.base import SourceDocument
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.library_process import LibraryProcess
from aoprecalc.io.formats.polygons import Polygons
from aoprecalc.io.formats.textures import PartSource
from aoprecalc.io.formats.usd.materials import UsdMaterial
from aoprecalc.types import Float64Array, Int64Array

# Damage in a binary layer may hang or crash USD: another process reads it, and any layer that may refer to one.
USD = LibraryProcess("USD", "aoprecalc.io.formats.usd")
_MAX_TOLD = 5  # warnings of USD that are passed on


@dataclass(frozen=True, eq=False, kw_only=True)
class UsdPart(PartSource):
    """The faces of a Mesh prim that have one material.

    prim       the path of the Mesh, of an instance where it is in one
    owner      the path of the prim to which the material is bound: the Mesh, or a GeomSubset of it
    original   the path of the Mesh in the prototype that its instances share; `prim` where there is none
    faces      (p,) the faces of the prim that these polygons are
    corners    (sum of their counts,) the face corner of the prim that each polygon corner is; the polygons are
               counter-clockwise seen from the front, those of a left-handed or mirrored prim are not
    polygons   the polygons, and their triangles, which are those of the part
    normals    the prim has normals
    uv_names   the primvar of each UV set
    linear     (3, 3) by which column vectors of the prim come into the world
    look       the material; None where it has none
    """

    prim: str
    owner: str
    original: str
    faces: Int64Array
    corners: Int64Array
    polygons: Polygons
    normals: bool
    uv_names: tuple[str, ...]
    linear: Float64Array
    look: UsdMaterial | None


@dataclass(frozen=True, eq=False)
class UsdDocument(SourceDocument):
    """What is kept of a stage.

    files   those that it was composed of, and its textures
    names   the paths of files in its root layer, as it states them
    """

    files: tuple[Path, ...] = ()
    names: tuple[str, ...] = ()


def part_source(source: object) -> UsdPart:
    """Return where a part comes from."""
    assert isinstance(source, UsdPart)  # the reader made it
    return source


@contextmanager
def usd_messages(path: Path) -> Iterator[list[str]]:
    """Collect the warnings of USD, which it would print, in a list; raises InputError for its errors."""
    from pxr import Tf, UsdUtils

    told: list[str] = []
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield told
    except (Tf.ErrorException, RuntimeError) as error:
        found = re.findall(r" : '(.*?)'$", str(error), re.MULTILINE | re.DOTALL) or [str(error)]
        raise damaged_file(path, f"cannot be read as USD ({_one_line(found[0])})") from error
    finally:
        warnings = [_one_line(entry.commentary) for entry in delegate.TakeUncoalescedDiagnostics()]
        told += dict.fromkeys(warnings)
        if len(told) > _MAX_TOLD:
            told[_MAX_TOLD:] = [f"USD has {len(told) - _MAX_TOLD} more warnings of this stage"]


def _one_line(text: str) -> str:
    """Return a message of USD without what differs from run to run."""
    text = re.sub(r"\s*\((instantiating|recomposing) stage.*", "", text, flags=re.DOTALL)
    text = re.sub(r",?@anon:0x[0-9a-f]+:[^@]*@", "", text)
    return " ".join(text.split())[:240]


def stage_files(path: Path) -> tuple[Path, ...]:
    """Return the files that a stage is composed of or refers to, without itself, existing or not."""
    from pxr import Ar, UsdUtils

    layers, assets, missing = UsdUtils.ComputeAllDependencies(str(path))
    names = [*(layer.realPath for layer in layers), *map(str, assets), *map(str, missing)]
    plain = (Ar.SplitPackageRelativePathOuter(name)[0] if "[" in name else name for name in names if name)
    files = dict.fromkeys(path.parent / name for name in plain)
    return tuple(file for file in files if file.absolute() != path.absolute())


def is_alone(data: bytes) -> bool:
    """Tell whether it is a text layer without the path of any other file; these stand between @."""
    return data.startswith(b"#usda") and b"@" not in data
