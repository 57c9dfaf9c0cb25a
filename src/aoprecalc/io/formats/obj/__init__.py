"""Wavefront OBJ with its material library (MTL)."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from aoprecalc.io.formats.archives import check_pictures
from aoprecalc.io.formats.base import (
    MeshFormat,
    MeshWithAo,
    PartOcclusion,
    WrittenMesh,
    source_colors,
    source_materials,
)
from aoprecalc.io.formats.files import ColorImages, ImageSource
from aoprecalc.io.formats.obj.materials import MtlMaterial, material_files
from aoprecalc.io.formats.obj.reader import ObjDocument, Section, obj_files, read_obj
from aoprecalc.io.formats.obj.writer import write_obj
from aoprecalc.io.formats.textures import first_uvs, part_material
from aoprecalc.io.outputs import Outputs
from aoprecalc.types import Atlas, BaseColor, Part, Scene

_VERTEX = re.compile(rb"^[ \t]*v[ \t]+-?[\d.]", re.MULTILINE)
_FACE = re.compile(rb"^[ \t]*f[ \t]+-?\d", re.MULTILINE)


class ObjFormat(MeshFormat):
    """Every group and material, polygons, UVs and normals; written with an MTL that shows the texture."""

    name = "OBJ"
    extensions = (".obj",)
    writes = holds_textures = True

    def sniff(self, data: bytes) -> bool:
        """Tell whether there are lines of vertices and of faces."""
        return b"\0" not in data and bool(_VERTEX.search(data) and _FACE.search(data))

    def read(self, path: Path, data: bytes) -> Scene:
        """Read the file, and the MTL files it names where they lie beside it."""
        return read_obj(path, data)

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the MTL files and the textures that these name."""
        return obj_files(path, data)

    def object_of(self, part: Part) -> str:
        """Return the name of its object, else of its group."""
        assert isinstance(part.source, Section | None)  # the reader made it
        section = part.source or Section()
        return section.object or section.group or "mesh"

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the OBJ, its MTL files and their textures."""
        document = _document(scene)
        return [scene.path, *document.libraries, *material_files(document.materials.values())]

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
        """Return .obj, unless new UVs would take the place of those with which baked parts show their textures."""
        if atlases and all(atlas.uv_set is not None for atlas in atlases):
            return ".obj", ""
        materials = source_materials(scene)
        with_uvs = [part for part in scene.parts if scene.uvs is not None and scene.uvs[part.faces].any()]
        used = dict.fromkeys(name for part in with_uvs if part.receives and (name := part_material(part)))
        textured = [name for name in used if name in materials and materials[name].pictured]
        if not textured:
            return ".obj", ""
        names = ", ".join(textured[:3]) + (", ..." if len(textured) > 3 else "")
        found = f"OBJ holds one set of UVs, which the textures of its materials ({names}) need"
        return ".glb", f"{found}, so the mesh becomes a GLB with both"

    def check_source(self, path: Path, scene: Scene) -> None:
        """Raise UsageError for a mesh of a ZIP, whose pictures it could not refer to."""
        check_pictures(path, scene)

    def write_with_ao(self, outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
        """Write an OBJ and its MTL; see `write_obj`."""
        written, notes = write_obj(outputs, path, mesh)
        return replace(written, messages=(*written.messages, *self.losses(path, mesh), *notes))

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return map_Ka of the part's material, else its map_Kd."""
        material: MtlMaterial | None = _document(scene).materials.get(part_material(part) or "")
        path = None if material is None else material.occlusion
        image = None if path is None else ImageSource.of(path)
        return PartOcclusion(image, first_uvs(scene, part), stated=False)

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return Kd and map_Kd of each part's material, and the colours of the vertices."""
        materials, colors = _document(scene).materials, source_colors(scene)
        return tuple(
            materials.get(part_material(part) or "", MtlMaterial("")).base_color(
                first_uvs(scene, part), images, occlusion, None if colors is None else colors[part.faces, :, :3]
            )
            for part in scene.parts
        )


def _document(scene: Scene) -> ObjDocument:
    assert isinstance(scene.document, ObjDocument)  # the reader made it
    return scene.document
