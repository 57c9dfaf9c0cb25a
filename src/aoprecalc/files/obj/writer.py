"""Writes Wavefront OBJ with an MTL that shows the ambient occlusion as the diffuse texture, or beside it."""

from collections.abc import Sequence
from pathlib import Path

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.obj.edit import edit_lines
from aoprecalc.files.obj.fresh import fresh_document
from aoprecalc.files.obj.library import library_lines, material_names
from aoprecalc.files.obj.reader import ObjDocument
from aoprecalc.files.one_set import what_is_lost
from aoprecalc.files.references import relative_path
from aoprecalc.model import Atlas, Floats, Scene
from aoprecalc.options import Pack


def write_obj(
    outputs: Outputs, path: Path, scene: Scene, atlas: Atlas, normals: Floats, texture: Path, pack: Pack = "none"
) -> tuple[str, ...]:
    """Write an OBJ and, beside it, an MTL of the same stem; return what the user should know.

    An OBJ source is kept line by line but for the faces that receive, and its materials but for theirs: these show the
    texture as map_Kd and lose their other pictures, which were made for other UVs. Where the file's own UVs were used
    they keep them, and a material that has a map_Kd shows the texture as map_Ka.
    """
    document = scene.document if isinstance(scene.document, ObjDocument) else fresh_document(scene)
    names = material_names(scene.parts, document.materials)
    library = path.with_suffix(".mtl")
    edited = edit_lines(document, scene, atlas, normals, names)
    outputs.path(path).write_bytes(_encode([f"mtllib {library.name}", *edited]))
    lines, said = library_lines(
        document, names, scene.path, library, relative_path(texture, path), kept=atlas.uv_set == 0
    )
    outputs.path(library).write_bytes(_encode(lines))
    return said or what_is_lost(path, scene, atlas)


def _encode(lines: Sequence[str]) -> bytes:
    return ("\n".join(lines).rstrip("\n") + "\n").encode("utf-8", "surrogateescape")
