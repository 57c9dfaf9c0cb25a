"""USD stages (.usd, .usda, .usdc, .usdz), by usd-core."""

from importlib.util import find_spec
from pathlib import Path

from aoprecalc.errors import AoprecalcError, InputError
from aoprecalc.io.formats.base import MeshFormat, MeshWithAo, PartOcclusion, WrittenMesh
from aoprecalc.io.formats.files import ColorImages
from aoprecalc.io.formats.library_process import answer_request
from aoprecalc.io.formats.textures import first_uvs
from aoprecalc.io.formats.usd.editor import StageEdits, edit_stage
from aoprecalc.io.formats.usd.reader import read_stage
from aoprecalc.io.formats.usd.stage import (
    USD,
    UsdDocument,
    is_alone,
    part_source,
    stage_files,
    usd_messages,
)
from aoprecalc.io.formats.usd.writer import check_source, write_usd
from aoprecalc.io.outputs import Outputs
from aoprecalc.subprocesses import ChildTimeoutError, report_step
from aoprecalc.types import BaseColor, Part, Scene


class UsdFormat(MeshFormat):
    """The meshes of a stage that are shown; the stage is written back with everything else unchanged."""

    name = "USD"
    extensions = (".usd", ".usda", ".usdc", ".usdz")
    writes = alpha = holds_options = True
    one_uv_set = False

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a binary layer, a text one, or a ZIP that begins with one."""
        first = data[30 : 30 + int.from_bytes(data[26:28], "little")] if data.startswith(b"PK\3\4") else b""
        return data.startswith((b"PXR-USDC", b"#usda")) or first.lower().endswith((b".usd", b".usda", b".usdc"))

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the meshes with the materials that are bound to them; raises InputError where usd-core is missing."""
        if find_spec("pxr") is None:
            raise InputError(f"{path}: USD needs the package usd-core; `pip install 'aoprecalc[usd]'`")
        if is_alone(data):
            return read_stage(path)
        scene = USD.work(path, len(data), (path, "scene"))
        assert isinstance(scene, Scene)
        return scene

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return its sublayers, references, payloads and textures."""
        if find_spec("pxr") is None or is_alone(data):
            return []
        try:
            files: tuple[Path, ...] = USD.ask(len(data), (path, "files"))
        except (AoprecalcError, ChildTimeoutError, OSError):  # reading it will fail, too, and say why
            return []
        return list(files)

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the stage and those files."""
        return [scene.path, *_document(scene).files]

    def check_source(self, path: Path, scene: Scene) -> None:
        """Raise UsageError unless the scene is that of a stage that can be written at `path`."""
        check_source(path, scene)

    def write_with_ao(self, outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
        """Write the stage with the occlusion in its materials; see `write_usd`."""
        return write_usd(outputs, path, mesh)

    def object_of(self, part: Part) -> str:
        """Return the path of its Mesh: the subsets of that are one object."""
        return part_source(part.source).prim

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return the occlusion of the part's UsdPreviewSurface, and the UVs that it reads."""
        source = part_source(part.source)
        use = None if source.look is None else source.look.occlusion
        if use is None or use.uv_name not in source.uv_names:
            return PartOcclusion(None, first_uvs(scene, part))
        uvs = scene.uv_sets[source.uv_names.index(use.uv_name)][part.faces]
        return PartOcclusion(use.image, use.transform(uvs), extras=use.baked or None)

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


def answer() -> None:
    """In the child: send back what the parent asks for; see `_made_of`."""
    answer_request(_made_of)


def _made_of(request: tuple[Path, object]) -> object:
    """Return what is wanted of the stage at a path: its `files`, its `scene`, or itself with edits."""
    path, wanted = request
    with usd_messages(path):
        files = stage_files(path)
    if wanted == "files":
        return files
    report_step(str(sum(file.stat().st_size for file in (path, *files) if file.is_file())))
    return edit_stage(path, wanted) if isinstance(wanted, StageEdits) else read_stage(path, files)
