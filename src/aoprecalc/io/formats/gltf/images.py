"""Pictures in a glTF document that is being written: the baked ones, and the files that its images refer to."""

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import chain, count
from pathlib import Path
from urllib.parse import quote

from aoprecalc.errors import InputError
from aoprecalc.io.formats.gltf.buffers import GltfBuffer
from aoprecalc.io.formats.gltf.document import Json, data_uri, local_file
from aoprecalc.io.formats.gltf.occlusion_textures import OrmPicture
from aoprecalc.io.formats.gltf.references import place
from aoprecalc.io.images import png_bytes, read_image
from aoprecalc.io.outputs import Outputs, relative_uri

REPEAT, CLAMP_TO_EDGE = 10497, 33071
LINEAR, LINEAR_MIPMAP_LINEAR = 9729, 9987

# What glTF images may hold by their first bytes; the last two through extensions.
_MIME_TYPES = {
    b"\x89PNG": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"RIFF": "image/webp",
    b"\xabKTX 20\xbb": "image/ktx2",
}


def add_texture(
    outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, texture: Path, wraps: bool
) -> tuple[int, tuple[str, ...]]:
    """Add the baked texture to the document that will be at `path`: within a GLB, else by a relative URI.

    A picture that glTF cannot hold (EXR, TIFF ...) is given as a PNG of 8 bits, which lies beside it or in the GLB.

    Returns the number of the new texture, and what the user should know.
    """
    warnings: tuple[str, ...] = ()
    data = outputs.written(texture).read_bytes()
    if _mime_type(data) not in ("image/png", "image/jpeg"):
        data = png_bytes(read_image(outputs.written(texture)))
        warnings = (f"{path}: glTF holds no {texture.suffix} pictures; it has a copy as PNG of 8 bits",)
        texture = next(_names(outputs, texture.with_suffix(".png")))
        if not _embeds(path):
            outputs.path(texture).write_bytes(data)
    image = place(document, "images", _image(path, buffer, texture, data))
    wrap = REPEAT if wraps else CLAMP_TO_EDGE
    sampler = {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap}
    return _add(document, image, sampler), warnings


def add_orm_textures(
    outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, texture: Path, pictures: Mapping[int, OrmPicture]
) -> dict[int, int]:
    """Add packed pictures, which have their names from the baked texture's, each once.

    pictures   number of a material -> its picture

    Returns number of a material -> that of its new texture.
    """
    names = _names(outputs, texture.with_name(f"{texture.stem}_orm.png"))
    images: dict[bytes, int] = {}
    textures: dict[OrmPicture, int] = {}
    for picture in pictures.values():
        if picture.data not in images:
            file = next(names)
            if not _embeds(path):
                outputs.path(file).write_bytes(picture.data)
            images[picture.data] = place(document, "images", _image(path, buffer, file, picture.data))
        if picture not in textures:
            textures[picture] = _add(document, images[picture.data], picture.sampler)
    return {index: textures[picture] for index, picture in pictures.items()}


def carry_images(outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, source: Path) -> tuple[str, ...]:
    """Make the files that the images of a document refer to reachable from `path`.

    They are put into a GLB, and copied beside a .gltf that lies in another folder than the `source` document.

    Returns what the user should know: which files are missing.
    """
    embed = _embeds(path)
    if not embed and path.parent.resolve() == source.parent.resolve():
        return ()
    warnings, missing = [], []
    copies: dict[Path, str] = {}
    for image in filter(None, document.get("images", [])):
        uri = image.get("uri", "")
        if embed and uri.startswith("data:"):
            with suppress(InputError):  # a damaged one stays as it is
                _embed(image, buffer, data_uri(source, uri))
        file = local_file(source, uri) if uri else None
        if file is None:
            continue
        try:
            data = file.read_bytes()
        except OSError:
            missing.append(file.name)
            continue
        if not embed:
            if file not in copies:
                copies[file] = _free_name(outputs, path, file.name, data)
                outputs.path(path.parent / copies[file]).write_bytes(data)
            image["uri"] = quote(copies[file])
        elif not _embed(image, buffer, data):
            warnings.append(f"{path}: a GLB cannot hold the image {uri[:60]!a}; it is referred to by its path")
            image["uri"] = relative_uri(file, path)
    if missing:
        warnings.append(f"{len(missing)} images cannot be read and are missing from the result: {', '.join(missing)!a}")
    return tuple(warnings)


def _embed(image: Json, buffer: GltfBuffer, data: bytes) -> bool:
    """Put the bytes of a picture in the place of its URI, where glTF has a name for what they are."""
    mime_type = _mime_type(data)
    if mime_type is None:
        return False
    del image["uri"]
    image |= {"bufferView": buffer.add_view(data), "mimeType": mime_type}
    return True


def _mime_type(data: bytes) -> str | None:
    return next((kind for start, kind in _MIME_TYPES.items() if data.startswith(start)), None)


def _free_name(outputs: Outputs, path: Path, name: str, data: bytes) -> str:
    """Return the name, with a number before its extension if beside `path` it is another output's or another file's.

    Where others write there at the same time it has a digest of the picture instead, whatever lies there.
    """
    if outputs.staged:
        file = Path(name)
        return f"{file.stem}-{hashlib.sha256(data).hexdigest()[:8]}{file.suffix}"
    own = (path, path.with_suffix(".bin"))
    return next(
        free.name
        for free in _names(outputs, path.parent / name)
        if free not in own and (not free.exists() or free.read_bytes() == data)
    )


def _names(outputs: Outputs, file: Path) -> Iterator[Path]:
    """Yield a file's name, then others with a number before the extension, but for those of other outputs."""
    numbered = (file.with_name(f"{file.stem}_{number}{file.suffix}") for number in count(1))
    return (name for name in chain([file], numbered) if outputs.written(name) == name)


def _embeds(path: Path) -> bool:
    """Tell whether a document of that name holds its pictures in itself."""
    return path.suffix.lower() == ".glb"


def _image(path: Path, buffer: GltfBuffer, file: Path, data: bytes) -> Json:
    """Return the entry of a picture that lies, or would lie, in a file."""
    if not _embeds(path):
        return {"uri": relative_uri(file, path)}
    return {"name": file.stem, "bufferView": buffer.add_view(data), "mimeType": _mime_type(data)}


def _add(document: Json, image: int, sampler: Json | None) -> int:
    """Add a texture, with a sampler that is there already if it can be; return its number."""
    entry: Json = {"source": image}
    if sampler is not None:
        samplers = document.get("samplers", [])
        known = sampler in samplers
        entry = {"sampler": samplers.index(sampler) if known else place(document, "samplers", sampler), **entry}
    return place(document, "textures", entry)
