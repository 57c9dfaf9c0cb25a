"""glTF 2.0, as .gltf with its buffer and images beside it, or as one .glb, which avatars call .vrm."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

from aoprecalc.errors import AoprecalcError
from aoprecalc.io.formats.base import MeshFormat, MeshWithAo, PartOcclusion, PartSpaces, WrittenMesh
from aoprecalc.io.formats.builder import damaged_file
from aoprecalc.io.formats.files import ColorImages
from aoprecalc.io.formats.gltf.animation import posed_document
from aoprecalc.io.formats.gltf.document import MAGIC, GltfDocument, gltf_files
from aoprecalc.io.formats.gltf.materials import base_color
from aoprecalc.io.formats.gltf.occlusion_textures import gltf_occlusion
from aoprecalc.io.formats.gltf.reader import PrimitiveSource, part_mesh, part_primitive, read_gltf, read_posed
from aoprecalc.io.formats.gltf.vertices import part_spaces
from aoprecalc.io.formats.gltf.writer import write_gltf
from aoprecalc.io.outputs import Outputs
from aoprecalc.types import BaseColor, Part, Scene


class GltfFormat(MeshFormat):
    """The triangles of the shown scene; written back with everything else unchanged."""

    name = "glTF"
    extensions = (".gltf", ".glb", ".vrm")
    writes = packs_orm = alpha = holds_options = has_strength = True
    holds_vertex_ao = holds_textures = holds_tangents = True
    holds_directional = (".png", ".jpg", ".jpeg")
    one_uv_set = False

    def sniff(self, data: bytes) -> bool:
        """Tell whether it is a GLB, or JSON with an asset."""
        return data.startswith(MAGIC) or (data.lstrip()[:1] == b"{" and b'"asset"' in data)

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the scene that the file shows, in its rest pose."""
        return read_gltf(path, data)

    def in_pose(self, scene: Scene, pose: str) -> Scene:
        """Return the scene where a clip of the file stands at a time."""
        with _damage_told(scene, "its animations cannot be read"):
            document, warnings = posed_document(_document(scene), pose)
            return replace(read_posed(scene, document), warnings=warnings)

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the files of its buffers and images."""
        return gltf_files(path, data)

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the document and the files of its buffers and images."""
        return [scene.path, *_document(scene).files()]

    def write_with_ao(self, outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
        """Write a .gltf or .glb with the texture as occlusion texture; see `write_gltf`."""
        if not isinstance(mesh.scene.document, GltfDocument):
            written = write_gltf(outputs, path, mesh)
        else:
            with _damage_told(mesh.scene, "it cannot be written back"):
                written = write_gltf(outputs, path, mesh)
        if path.suffix.lower() != ".vrm" or mesh.scene.format == "vrm":
            return written
        lacks = f"{path}: lacks what makes an avatar of a GLB, as {mesh.scene.path.name} has none; write a .glb"
        return replace(written, messages=(*written.messages, lacks))

    def grouped(self, scene: Scene, part: Part, by: Literal["material", "mesh"]) -> tuple[int, str]:
        """Return the index of the material or mesh of a part, -1 for none, and its name."""
        document = _document(scene)
        with _damage_told(scene):
            primitive, kind = part_primitive(document, part), "materials" if by == "material" else "meshes"
            index: int = primitive.get("material", -1) if by == "material" else part_mesh(part)
            return index, document.entry(kind, index).get("name", "") if index >= 0 else ""

    def spaces(self, scene: Scene, part: Part) -> PartSpaces:
        """Return the transform of the part's node, its tangents, and the UVs of its normalTexture."""
        with _damage_told(scene):
            return part_spaces(_document(scene), scene, part)

    def object_of(self, part: Part) -> int:
        """Return the index of its node: the primitives of its mesh are one object."""
        assert isinstance(part.source, PrimitiveSource)  # the reader made it
        return part.source.node

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return the occlusionTexture of the part's material."""
        with _damage_told(scene):
            return gltf_occlusion(_document(scene), part)

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return base colour factor, texture and vertex colours of each part, or those of specular and glossiness."""
        document = _document(scene)
        with _damage_told(scene):
            return tuple(
                base_color(document, part_primitive(document, part), part.vertices, images) for part in scene.parts
            )


@contextmanager
def _damage_told(scene: Scene, found: str = "its materials cannot be read") -> Iterator[None]:
    """Raise an InputError for whatever a damaged document provokes."""
    try:
        yield
    except (AoprecalcError, OSError, MemoryError):
        raise
    except Exception as error:
        raise damaged_file(scene.path, f"{found} ({type(error).__name__}: {error})") from error


def _document(scene: Scene) -> GltfDocument:
    assert isinstance(scene.document, GltfDocument)  # the reader made it
    return scene.document
