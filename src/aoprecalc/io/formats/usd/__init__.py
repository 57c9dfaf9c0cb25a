"""USD stages (.usd, .usda, .usdc, .usdz), by usd-core."""

import pickle
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io.formats.base import MeshFormat, PartOcclusion, first_uvs
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.files import ColorImages
from aoprecalc.io.formats.usd.reader import UsdDocument, part_source, read_stage, stage_files
from aoprecalc.subprocesses import ChildTimeoutError, ask, end_with_parent
from aoprecalc.types import Atlas, BaseColor, Part, Scene

_CHILD = [sys.executable, "-P", "-c", "from aoprecalc.io.formats.usd import answer; answer()"]
_SECONDS, _BYTES_PER_SECOND = 60.0, 1e6  # for which a child may read


class UsdFormat(MeshFormat):
    """The meshes of a stage that are shown."""

    name = "USD"
    extensions = (".usd", ".usda", ".usdc", ".usdz")
    one_uv_set = False
    alpha = True
    not_read = "its lights, cameras, animation and other prims than meshes"

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a binary layer, a text one, or a ZIP that begins with one."""
        first = data[30 : 30 + int.from_bytes(data[26:28], "little")] if data.startswith(b"PK\3\4") else b""
        return data.startswith((b"PXR-USDC", b"#usda")) or first.lower().endswith((b".usd", b".usda", b".usdc"))

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the meshes with the materials that are bound to them; raises InputError where usd-core is missing."""
        if find_spec("pxr") is None:
            raise InputError(f"{path}: USD needs the package usd-core; `pip install 'aoprecalc[usd]'`")
        return read_stage(path) if data.startswith(b"#usda") else _read_apart(path, len(data))

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return its sublayers, references, payloads and textures."""
        return [] if find_spec("pxr") is None else list(stage_files(path))

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
        return BaseColor() if texture is None else BaseColor((1.0, 1.0, 1.0), texture, uvs)


def _document(scene: Scene) -> UsdDocument:
    assert isinstance(scene.document, UsdDocument)  # the reader made it
    return scene.document


# Damage in a binary layer may hang or crash USD, so that another process reads it.


def _read_apart(path: Path, size: int) -> Scene:
    seconds = _SECONDS + size / _BYTES_PER_SECOND
    try:
        found = pickle.loads(ask(_CHILD, pickle.dumps(path), timeout=seconds))
    except ChildTimeoutError as error:
        raise damaged_file(path, f"USD has not read it within {seconds:.0f} s") from error
    except OSError as error:
        raise damaged_file(path, f"USD could not read it ({error})") from error
    if isinstance(found, Exception):
        raise found
    assert isinstance(found, Scene)
    return found


def answer() -> None:
    """In the child: read the stage that the parent asks for, and send it, or the error, back."""
    end_with_parent()
    path: Path = pickle.loads(sys.stdin.buffer.read())
    found: Scene | Exception
    try:
        with np.errstate(all="ignore"):
            found = read_stage(path)
    except AoprecalcError as error:
        found = error
    except Exception as error:
        sys.exit(" ".join(str(error).split())[:120] or type(error).__name__)
    sys.stdout.buffer.write(pickle.dumps(found))
