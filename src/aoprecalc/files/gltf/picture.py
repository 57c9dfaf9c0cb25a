"""Pictures in a glTF document that is being written: the baked texture, and the files that its images refer to."""

import tempfile
from itertools import chain, count
from pathlib import Path
from urllib.parse import quote

from aoprecalc.files.atomic import Outputs
from aoprecalc.files.gltf.buffer import GltfBuffer
from aoprecalc.files.gltf.document import Json, local_file
from aoprecalc.files.images import read_image, write_image
from aoprecalc.files.references import relative_uri

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
    embed = path.suffix.lower() == ".glb"
    warnings: tuple[str, ...] = ()
    data = outputs.written(texture).read_bytes()
    if _mime_type(data) not in ("image/png", "image/jpeg"):
        data = _as_png(outputs.written(texture))
        warnings = (f"{path}: glTF holds no {texture.suffix} pictures; it has a copy as PNG of 8 bits",)
        texture = texture.with_suffix(".png")
        if not embed:
            outputs.path(texture).write_bytes(data)
    image: Json = {"uri": relative_uri(texture, path)}
    if embed:
        image = {"name": texture.stem, "bufferView": buffer.add_view(data), "mimeType": _mime_type(data)}

    wrap = REPEAT if wraps else CLAMP_TO_EDGE
    sampler = {"magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": wrap, "wrapT": wrap}
    entry = {"sampler": _append(document, "samplers", sampler), "source": _append(document, "images", image)}
    return _append(document, "textures", entry), warnings


def carry_images(outputs: Outputs, path: Path, document: Json, buffer: GltfBuffer, source: Path) -> tuple[str, ...]:
    """Make the files that the images of a document refer to reachable from `path`.

    They are put into a GLB, and copied beside a .gltf that lies in another folder than the `source` document.

    Returns what the user should know: which files are missing.
    """
    embed = path.suffix.lower() == ".glb"
    if not embed and path.parent.resolve() == source.parent.resolve():
        return ()
    warnings, missing = [], []
    copies: dict[Path, str] = {}
    for image in document.get("images", []):
        file = local_file(source, image["uri"]) if "uri" in image else None
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
        elif mime_type := _mime_type(data):
            del image["uri"]
            image |= {"bufferView": buffer.add_view(data), "mimeType": mime_type}
        else:
            warnings.append(f"{path}: a GLB cannot hold the image {image['uri'][:60]!a}; it is referred to by its path")
            image["uri"] = relative_uri(file, path)
    if missing:
        warnings.append(f"{len(missing)} images cannot be read and are missing from the result: {', '.join(missing)!a}")
    return tuple(warnings)


def _mime_type(data: bytes) -> str | None:
    return next((kind for start, kind in _MIME_TYPES.items() if data.startswith(start)), None)


def _as_png(picture: Path) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "picture.png"
        write_image(copy, read_image(picture), "8")
        return copy.read_bytes()


def _free_name(outputs: Outputs, path: Path, name: str, data: bytes) -> str:
    """Return the name, with a number before its extension if beside `path` it is another output's or another file's."""
    file = path.parent / name
    names = chain([file], (file.with_name(f"{file.stem}_{number}{file.suffix}") for number in count(1)))
    own = (path, path.with_suffix(".bin"))
    return next(
        free.name
        for free in names
        if free not in own and outputs.written(free) == free and (not free.exists() or free.read_bytes() == data)
    )


def _append(document: Json, kind: str, entry: Json) -> int:
    entries: list[Json] = document.setdefault(kind, [])
    entries.append(entry)
    return len(entries) - 1
