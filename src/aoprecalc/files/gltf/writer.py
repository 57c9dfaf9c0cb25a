"""Writes glTF 2.0, as .gltf with its buffer beside it or as one .glb."""

import json
import struct
from pathlib import Path

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.gltf.document import BIN_CHUNK, JSON_CHUNK, MAGIC, GltfDocument, Json
from aoprecalc.files.gltf.edit import edit_document
from aoprecalc.files.gltf.entries import close_gaps, release
from aoprecalc.files.gltf.fresh import fresh_document, show_texture
from aoprecalc.files.gltf.materials import occlude, own_materials, replaced_references
from aoprecalc.files.gltf.orm import OrmPicture, orm_pictures
from aoprecalc.files.gltf.picture import add_orm_textures, add_texture, carry_images
from aoprecalc.files.images import read_image
from aoprecalc.model import Atlas, Floats, Scene
from aoprecalc.options import Pack


def write_gltf(
    outputs: Outputs, path: Path, scene: Scene, atlas: Atlas, normals: Floats, texture: Path, pack: Pack = "none"
) -> tuple[str, ...]:
    """Write a .gltf or .glb with the texture as occlusion texture; return what the user should know.

    The document of a glTF source is kept but for that. Any other source gets a fresh one, in which the texture is
    the base colour too where a material has no picture of its own.
    """
    is_fresh = not isinstance(scene.document, GltfDocument)
    said: tuple[str, ...] = ()
    if isinstance(scene.document, GltfDocument):
        document, buffer, sets, said = edit_document(scene.document, scene, atlas, normals)
    else:
        document, buffer, sets = fresh_document(scene, atlas, normals)
    materials, about_materials = own_materials(document, sets)
    packed: dict[int, OrmPicture] = {}
    about_packing: tuple[str, ...] = ()
    if pack == "orm":
        so_far = GltfDocument(scene.path, document, (buffer.data,))
        packed, about_packing = orm_pictures(so_far, materials, atlas, read_image(outputs.written(texture)))

    release(document, buffer, replaced_references(document, materials, packed))
    about_images = carry_images(outputs, path, document, buffer, scene.path)
    textures = add_orm_textures(outputs, path, document, buffer, texture, packed)
    about_texture: tuple[str, ...] = ()
    if len(textures) < len(materials):
        number, about_texture = add_texture(outputs, path, document, buffer, texture, atlas.wraps)
        textures = dict.fromkeys(materials, number) | textures
        if is_fresh:
            show_texture(document, sets, number)
    occlude(document, materials, textures, packed)
    close_gaps(document)
    _write(outputs, path, document, buffer.data)
    return (*said, *about_materials, *about_packing, *about_images, *about_texture)


def _write(outputs: Outputs, path: Path, document: Json, data: bytes) -> None:
    document["buffers"] = [{"byteLength": len(data)}]
    if path.suffix.lower() == ".glb":
        text = json.dumps(document, separators=(",", ":")).encode()
        outputs.path(path).write_bytes(glb(text, data))
        return
    binary = path.with_suffix(".bin")
    document["buffers"][0] = {"uri": binary.name, **document["buffers"][0]}
    outputs.path(binary).write_bytes(data)
    outputs.path(path).write_bytes(json.dumps(document, indent=1).encode() + b"\n")


def glb(text: bytes, data: bytes) -> bytes:
    """Lay out a GLB: the document's text, then its binary chunk, where that holds anything."""
    chunks = b""
    for kind, content, filler in ((JSON_CHUNK, text, b" "), (BIN_CHUNK, data, b"\0")):
        padded = content + filler * (-len(content) % 4)
        chunks += struct.pack("<II", len(padded), kind) + padded
    return MAGIC + struct.pack("<II", 2, 12 + len(chunks)) + chunks
