"""Images of a glTF document that is written: the baked textures, and the image files of the source document."""

import hashlib
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from aoprecalc.errors import InputError, counted, listed, one_or_many
from aoprecalc.io.formats.base import Placement, SourceMaterial
from aoprecalc.io.formats.files import ImageSource, read_file
from aoprecalc.io.formats.gltf.document import BINARY_EXTENSIONS, Json, data_uri, is_misnamed, local_file
from aoprecalc.io.formats.gltf.materials import TRANSFORM
from aoprecalc.io.formats.gltf.occlusion_textures import OrmImage
from aoprecalc.io.formats.gltf.references import GltfBuffer, add_entry
from aoprecalc.io.images import png_bytes, quantize, read_image
from aoprecalc.io.outputs import Outputs, relative_uri
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import srgb_from_linear
from aoprecalc.types import Float32Array

REPEAT, CLAMP_TO_EDGE = 10497, 33071
LINEAR, LINEAR_MIPMAP_LINEAR = 9729, 9987

_LINEAR = (".exr", ".hdr")  # formats of linear floats
_MAX_NAMES = 20  # of missing files in a warning

# The types of glTF images by their first bytes; those after JPEG need extensions.
_MIME_TYPES = {
    rb"\x89PNG": "image/png",
    rb"\xff\xd8\xff": "image/jpeg",
    rb"RIFF....WEBP": "image/webp",
    rb"\xabKTX 20\xbb": "image/ktx2",
    rb"DDS ": "image/vnd-ms.dds",
    rb"....ftypavi[fs]": "image/avif",
}


def add_texture(
    outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, texture: Path, text: str, *, repeats: bool
) -> tuple[int, tuple[Note, ...]]:
    """Add the baked texture to the document that will be at `path`: embedded in a GLB, else by a relative URI.

    A format that glTF does not allow (EXR, TIFF ...) is converted to an 8-bit PNG, beside the document or in the GLB.

    text      that the converted PNG carries
    repeats   its UVs extend beyond [0, 1]

    Returns the index of the new texture, and a note on a conversion.
    """
    notes: tuple[Note, ...] = ()
    data = outputs.written(texture).read_bytes()
    if _mime_type(data) not in ("image/png", "image/jpeg"):
        data = png_bytes(read_image(outputs.written(texture)), text)
        notes = (Note(f"{path}: glTF allows no {texture.suffix} images; it gets a copy as 8-bit PNG"),)
        texture = next(outputs.candidates(texture.with_suffix(".png")))
        if not _embeds(path):
            outputs.path(texture).write_bytes(data)
    image = add_entry(document, "images", _image(path, buffer, texture, data))
    return _add_texture(document, image, _sampler(REPEAT if repeats else CLAMP_TO_EDGE)), notes


def _sampler(wrap: int) -> Json:
    return {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap}


def add_orm_textures(
    outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, texture: Path, packed: Mapping[int, OrmImage]
) -> dict[int, int]:
    """Add packed images, each once; their file names derive from the baked texture's.

    packed   index of a material -> its image

    Returns index of a material -> index of its new texture.
    """
    names = outputs.candidates(texture.with_name(f"{texture.stem}_orm.png"))
    images: dict[bytes, int] = {}
    textures: dict[OrmImage, int] = {}
    for image in packed.values():
        if image.data not in images:
            file = next(names)
            if not _embeds(path):
                outputs.path(file).write_bytes(image.data)
            images[image.data] = add_entry(document, "images", _image(path, buffer, file, image.data))
        if image not in textures:
            textures[image] = _add_texture(document, images[image.data], image.sampler)
    return {index: textures[image] for index, image in packed.items()}


def add_base_textures(
    outputs: Outputs,
    path: Path,
    document: Json,
    buffer: GltfBuffer,
    materials: Mapping[int, SourceMaterial],
    source: Path,
) -> tuple[str, ...]:
    """Give materials of a document that will be at `path` the base colour textures of those they are made from.

    materials   index of a material -> the one of the source
    source      the path of the source; a .gltf in its folder refers to the same files

    What glTF cannot hold becomes a PNG: pictures that are no PNG or JPEG, and the opacity of another picture, which
    goes into the alpha. Returns a warning about each that cannot be read, and a note about those that were converted.
    """
    warnings, converted = list[str](), dict[str, None]()
    if lost := list(dict.fromkeys(what for material in materials.values() for what in material.left_out)):
        found = f"what else the materials of {source.name} have is left out: {listed(lost, _MAX_NAMES)}"
        warnings.append(f"{path}: {found}")
    images: dict[tuple[ImageSource | None, ImageSource | None, str], int] = {}
    stay = path.parent.resolve() == source.parent.resolve()
    for index, material in materials.items():
        blends = material.alpha_mode != "OPAQUE" and material.opacity_map not in (None, material.texture)
        key = material.texture, material.opacity_map if blends else None, material.opacity_channel if blends else ""
        if key[:2] == (None, None):
            continue
        if key not in images:
            try:
                file, data, made = _base_picture(*key)
            except InputError as error:
                name = document["materials"][index]["name"]
                warnings.append(f"{path}: the material {name!a} is written without its picture: {error}")
                continue
            if made:
                converted |= dict.fromkeys(picture.file_name for picture in key[:2] if picture is not None)
            if not _embeds(path) and (made or not (stay and _is_file(key[0]))):
                file = outputs.free_path(path.with_name(file.name), data, (path, buffer_file(path)))
                outputs.path(file).write_bytes(data)
            images[key] = add_entry(document, "images", _image(path, buffer, file, data))
        _assign_base_texture(document, index, images[key], material.placement)
    if not converted:
        return tuple(warnings)
    names = ", ".join(f"{name!a}" for name in list(converted)[:_MAX_NAMES])
    return (*warnings, Note(f"{path}: glTF holds PNG and JPEG, so that PNGs are made of {names}"))


def _base_picture(color: ImageSource | None, opacity: ImageSource | None, channel: str) -> tuple[Path, bytes, bool]:
    """Return a path with a name for the PNG or JPEG of a colour and an opacity, its bytes, and whether it is new.

    Raises InputError where an image cannot be read.
    """
    image = color or opacity
    assert image is not None
    file = image.path or Path(image.file_name)
    if color is not None and opacity is None:
        color.pixels()  # a damaged file is no picture for glTF
        if _mime_type(data := color.content()) in ("image/png", "image/jpeg"):
            return file, data, False
    alpha = None if opacity is None else opacity.opacity(channel)
    name = f"{file.stem}.png" if opacity is None else f"{file.stem}_alpha.png"
    return file.with_name(name), _color_png(color, alpha), True


def _is_file(image: ImageSource | None) -> bool:
    return image is not None and image.path is not None


def _color_png(color: ImageSource | None, opacity: Float32Array | None = None) -> bytes:
    """Return an 8-bit PNG in sRGB of the colours of an image, and of its alpha or another one.

    color     floats of formats such as EXR count as linear; None: white
    opacity   (h, w) float32 in [0, 1], of any size: the larger size of both is written

    Raises InputError where the image cannot be read.
    """
    from PIL import Image

    pixels = np.ones((1, 1, 3), np.float32) if color is None else color.pixels()
    if color is not None and color.name.lower().endswith(_LINEAR):
        pixels[:, :, :3] = srgb_from_linear(pixels[:, :, :3])
    if pixels.shape[2] < 3:  # grey
        pixels = np.concatenate([pixels[:, :, :1].repeat(3, axis=2), pixels[:, :, 1:]], axis=2)
    image = Image.fromarray(quantize(pixels[:, :, :4], "8"))
    if opacity is not None:
        alpha = Image.fromarray(quantize(opacity, "8"))
        size = max(image.width, alpha.width), max(image.height, alpha.height)
        image = image.convert("RGB").resize(size, Image.Resampling.BILINEAR)
        image.putalpha(alpha.resize(size, Image.Resampling.BILINEAR))
    data = BytesIO()
    image.save(data, "PNG")
    return data.getvalue()


def _assign_base_texture(document: Json, material: int, image: int, placement: Placement) -> None:
    sampler = None
    if placement.wrap == "clamp":
        sampler = {
            "magFilter": LINEAR,
            "minFilter": LINEAR_MIPMAP_LINEAR,
            "wrapS": CLAMP_TO_EDGE,
            "wrapT": CLAMP_TO_EDGE,
        }
    info: Json = {"index": _add_texture(document, image, sampler)}
    (su, sv), (ou, ov) = placement.scale, placement.offset
    if (placement.scale, placement.offset) != ((1, 1), (0, 0)):
        # With v downwards, v = 1 - v', the offset of v' = sv v' + ov becomes 1 - sv - ov.
        info["extensions"] = {TRANSFORM: {"offset": [ou, 1 - sv - ov], "scale": [su, sv]}}
        if TRANSFORM not in document.setdefault("extensionsUsed", []):
            document["extensionsUsed"].append(TRANSFORM)
    document["materials"][material]["pbrMetallicRoughness"]["baseColorTexture"] = info


def carry_images(outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, source: Path) -> tuple[str, ...]:
    """Make the image files of a document reachable from `path`: embedded in a GLB, copied beside a .gltf elsewhere.

    source   the path of the source document; a .gltf in its folder refers to the same files

    References to files that are missing stay as they are. Returns a warning about these, and others.
    """
    embed = _embeds(path)
    stay = not embed and path.parent.resolve() == source.parent.resolve()
    warnings, missing = [], []
    copies: dict[Path, str] = {}
    for image in filter(None, document.get("images", [])):
        uri = image.get("uri", "")
        if embed and uri.startswith("data:"):
            with suppress(InputError):  # a damaged one is kept as it is
                _embed(image, buffer, data_uri(source, uri))
        file = local_file(source, uri) if uri else None
        if file is None:
            continue
        try:
            data = b"" if stay and file.is_file() else read_file(file)
        except OSError:
            missing.append(unquote(uri))
            continue
        if stay:
            if is_misnamed(source, uri, file):
                image["uri"] = relative_uri(file, path)
            continue
        if not embed and (_mime_type(data) or file.resolve().is_relative_to(source.parent.resolve())):
            if file not in copies:
                copies[file] = outputs.free_path(path.with_name(file.name), data, (path, buffer_file(path))).name
                outputs.path(path.parent / copies[file]).write_bytes(data)
            image["uri"] = relative_uri(path.parent / copies[file], path)
        elif not (embed and _embed(image, buffer, data)):
            found = "a GLB cannot hold the image" if embed else "not copied, as it is not an image:"
            warnings.append(f"{path}: {found} {uri[:60]!a}; it is referred to by its path")
            image["uri"] = relative_uri(file, path)
    if missing:
        warnings.append(_missing(source, list(dict.fromkeys(missing))))
    return tuple(warnings)


def _missing(source: Path, names: list[str]) -> str:
    """Return the warning about image files that the source document refers to and that are not there."""
    shown = listed([f"{name!a}" for name in names], _MAX_NAMES)
    it, was = one_or_many(len(names), "it", "they"), one_or_many(len(names), "was", "were")
    still = (
        f"{it} {was} missing before the bake, and the result still refers to {one_or_many(len(names), 'it', 'them')}"
    )
    return f"{source} refers to {counted(len(names), 'image')} that cannot be read: {shown}; {still}"


def _embed(image: Json, buffer: GltfBuffer, data: bytes) -> bool:
    """Embed an image instead of referring to its URI; return False if glTF does not know its type."""
    mime_type = _mime_type(data)
    if mime_type is None:
        return False
    del image["uri"]
    image |= {"bufferView": buffer.add_view(data), "mimeType": mime_type}
    return True


def _mime_type(data: bytes) -> str | None:
    return next((kind for start, kind in _MIME_TYPES.items() if re.match(start, data, re.DOTALL)), None)


def buffer_file(path: Path) -> Path:
    """Return the file for the buffer of a .gltf at `path`: of its name, or one like it that URIs need not escape.

    Some readers, trimesh among them, do not decode URIs, and without its buffer they could not read the mesh at all.
    """
    stem = re.sub(r"[^\w.~-]", "_", path.stem, flags=re.ASCII)
    if stem != path.stem:  # a digest tells it from that of another name beside it
        stem += "-" + hashlib.sha256(os.fsencode(path.stem)).hexdigest()[:8]
    return path.with_name(f"{stem}.bin")


def _embeds(path: Path) -> bool:
    """Tell whether a document of that name embeds its images."""
    return path.suffix.lower() in BINARY_EXTENSIONS


def _image(path: Path, buffer: GltfBuffer, file: Path, data: bytes) -> Json:
    """Return the image entry for a file, embedded where the document is a GLB."""
    if not _embeds(path):
        return {"uri": relative_uri(file, path)}
    return {"name": file.stem, "bufferView": buffer.add_view(data), "mimeType": _mime_type(data)}


def _add_texture(document: Json, image: int, sampler: Json | None) -> int:
    """Add a texture, reusing an equal sampler; return its index."""
    entry: Json = {"source": image}
    if sampler is not None:
        samplers = document.get("samplers", [])
        known = sampler in samplers
        entry = {"sampler": samplers.index(sampler) if known else add_entry(document, "samplers", sampler), **entry}
    return add_entry(document, "textures", entry)
