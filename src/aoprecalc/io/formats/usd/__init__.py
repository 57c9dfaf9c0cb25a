"""USD stages (.usd, .usda, .usdc, .usdz), by usd-core."""

import pickle
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io.formats.base import MeshFormat, PartOcclusion, first_uvs
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.files import ColorImages
from aoprecalc.io.formats.usd.reader import UsdDocument, part_source, read_stage, stage_files, usd_messages
from aoprecalc.subprocesses import ChildTimeoutError, ask, end_with_parent, report_step
from aoprecalc.types import Atlas, BaseColor, Part, Scene

_CHILD = [sys.executable, "-P", "-c", "from aoprecalc.io.formats.usd import answer; answer()"]
_SECONDS, _BYTES_PER_SECOND = 60.0, 1e6  # for which a child may read


class UsdFormat(MeshFormat):
    """The meshes of a stage that are shown."""

    name = "USD"
    extensions = (".usd", ".usda", ".usdc", ".usdz")
    one_uv_set = False
    alpha = True

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a binary layer, a text one, or a ZIP that begins with one."""
        first = data[30 : 30 + int.from_bytes(data[26:28], "little")] if data.startswith(b"PK\3\4") else b""
        return data.startswith((b"PXR-USDC", b"#usda")) or first.lower().endswith((b".usd", b".usda", b".usdc"))

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the meshes with the materials that are bound to them; raises InputError where usd-core is missing."""
        if find_spec("pxr") is None:
            raise InputError(f"{path}: USD needs the package usd-core; `pip install 'aoprecalc[usd]'`")
        return read_stage(path) if _is_alone(data) else _read_apart(path, len(data))

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return its sublayers, references, payloads and textures."""
        if find_spec("pxr") is None or _is_alone(data):
            return []
        try:
            files: tuple[Path, ...] = _ask_child(path, len(data), "files")
        except (ChildTimeoutError, OSError):  # reading it will fail, too, and say why
            return []
        return list(files)

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the stage and those files."""
        return [scene.path, *_document(scene).files]

    def output_extension(self, scene: Scene, atlas: Atlas | None) -> tuple[str, str]:
        """Return .glb."""
        return ".glb", f"{self.name} is not written, so the mesh becomes a GLB"

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return the occlusion of the part's UsdPreviewSurface, and the UVs that it reads."""
        source = part_source(part.source)
        use = None if source.look is None else source.look.occlusion
        if use is None or use.uv_name not in source.uv_names:
            return PartOcclusion(None, first_uvs(scene, part))
        uvs = scene.uv_sets[source.uv_names.index(use.uv_name)][part.faces]
        return PartOcclusion(use.image, use.transform(uvs))

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return the diffuse colour of each part's material, with its texture."""
        return tuple(self._base_color(scene, part, images) for part in scene.parts)

    def _base_color(self, scene: Scene, part: Part, images: ColorImages) -> BaseColor:
        source = part_source(part.source)
        if source.look is None:
            return BaseColor()
        use = source.look.color_texture
        if use is None or use.uv_name not in source.uv_names:
            return BaseColor(source.look.color)
        texture = images.get(use.image)
        uvs = use.transform(scene.uv_sets[source.uv_names.index(use.uv_name)][part.faces])
        return BaseColor() if texture is None else BaseColor(use.factor, texture, uvs)


def _document(scene: Scene) -> UsdDocument:
    assert isinstance(scene.document, UsdDocument)  # the reader made it
    return scene.document


# Damage in a binary layer may hang or crash USD, so that another process reads it, and any layer that may refer to one.


def _is_alone(data: bytes) -> bool:
    """Tell whether it is a text layer without the path of any other file; these stand between @."""
    return data.startswith(b"#usda") and b"@" not in data


def _read_apart(path: Path, size: int) -> Scene:
    try:
        found = _ask_child(path, size, "scene")
    except ChildTimeoutError as error:
        raise damaged_file(path, f"USD gave {error}") from error
    except OSError as error:
        raise damaged_file(path, f"USD could not read it ({error})") from error
    if isinstance(found, Exception):
        raise found
    assert isinstance(found, Scene)
    return found


def _ask_child(path: Path, size: int, wanted: str) -> Any:
    """Return the child's answer; its time depends on the bytes of the file and, once known, of those it refers to."""
    started = time.monotonic()

    def limit(step: str) -> None:
        seconds = _SECONDS + (int(step) if step.isdigit() else size) / _BYTES_PER_SECOND
        if time.monotonic() - started > seconds:
            raise ChildTimeoutError(round(seconds), step)

    return pickle.loads(ask(_CHILD, pickle.dumps((path, wanted)), limit))


def answer() -> None:
    """In the child: send what the parent asks for, the `files` of a stage or its `scene`, or the error, back."""
    end_with_parent()
    path, wanted = pickle.loads(sys.stdin.buffer.read())
    found: Scene | tuple[Path, ...] | Exception
    try:
        with usd_messages(path):
            found = files = stage_files(path)
        if wanted == "scene":
            report_step(str(sum(file.stat().st_size for file in (path, *files) if file.is_file())))
            with np.errstate(all="ignore"):
                found = read_stage(path, files)
    except AoprecalcError as error:
        found = () if wanted == "files" else error
    except Exception as error:
        sys.exit(" ".join(str(error).split())[:120] or type(error).__name__)
    sys.stdout.buffer.write(pickle.dumps(found))
