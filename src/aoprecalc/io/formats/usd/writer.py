"""Write a USD stage with the results of a bake: a layer beside the files that it refers to, or a package (.usdz)."""

import io
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from itertools import chain, count
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from aoprecalc.errors import UsageError, counted, listed, one_or_many
from aoprecalc.io.baked_options import bake_text
from aoprecalc.io.formats.archives import check_pictures, check_unpacked_size
from aoprecalc.io.formats.base import MeshWithAo, TextureReference, WrittenMesh
from aoprecalc.io.formats.files import UDIM, TextureCopies
from aoprecalc.io.formats.polygons import Polygons
from aoprecalc.io.formats.usd.editor import NEW_UVS, EditedStage, MaterialUse, MeshEdit, StageEdits
from aoprecalc.io.formats.usd.shading import BakedTexture
from aoprecalc.io.formats.usd.stage import USD, UsdDocument, part_source
from aoprecalc.io.images import png_bytes, read_image
from aoprecalc.io.outputs import Outputs, relative_path
from aoprecalc.mesh.surface import normalize
from aoprecalc.progress import Note
from aoprecalc.types import BoolArray, Float32Array, Int64Array, Part, Scene

PACKAGE = ".usdz"
_IN_PACKAGES = (".png", ".jpg", ".jpeg", ".exr")
_BINARY = b"PXR-USDC"
_ALIGNMENT, _PADDING_ID = 64, 0x1986  # of the files in a package; of the field that holds their padding
_UTF8_FLAG = 0x800  # of an entry whose name is UTF-8; zipfile reads others as cp437
_FIRST_DATE = (1980, 1, 1, 0, 0, 0)  # of a ZIP: the same for each file, so that the same input gives the same bytes
_EQUAL_WITHIN = 1e-6  # UVs that differ by no more are the same but for rounding


def check_source(path: Path, scene: Scene) -> None:
    """Raise UsageError unless a scene is that of a stage that can be written at `path`."""
    source = scene.path
    if not isinstance(scene.document, UsdDocument):
        raise UsageError(f"{path}: USD is written of USD only, but {source} is none; write a .glb")
    check_pictures(path, scene)
    if (path.suffix.lower() == PACKAGE) != (source.suffix.lower() == PACKAGE):
        advice = f"write a {PACKAGE}" if source.suffix.lower() == PACKAGE else "write a .usdc, and pack it with usdzip"
        raise UsageError(f"{path}: a package is written of a package only, and {source} differs; {advice}")


def write_usd(outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
    """Write a stage with the texture as the occlusion of its UsdPreviewSurfaces, and everything else as it is.

    Meshes get the UVs as a new primvar where the bake has not kept theirs. In another folder the stage gets copies of
    the pictures in its root layer, and refers to its other layers where they are. A package holds the texture.
    """
    check_source(path, mesh.scene)
    baked = mesh.only_texture(path)
    if path.suffix.lower() == PACKAGE:
        edited, notes = _write_package(outputs, path, mesh, baked.path)
    else:
        moved, notes = _moved_files(outputs, path, mesh.scene)
        suffix = path.suffix.lower()
        if suffix == ".usd":
            suffix = ".usdc" if _is_binary(mesh.scene.path.read_bytes()) else ".usda"
        edited = _edit(mesh, _anchored(relative_path(baked.path, path)), suffix, moved)
        outputs.path(path).write_bytes(edited.layer)
    slots = edited.materials.items()
    references = tuple(TextureReference("inputs:occlusion", f"primvars:{uvs}", number) for uvs, number in slots)
    return WrittenMesh(references, (*edited.messages, *notes))


def _is_binary(layer: bytes) -> bool:
    return layer.startswith(_BINARY)


def _anchored(name: str) -> str:
    """Return a relative path that USD looks for in the layer's folder only."""
    return name if name.startswith(("../", "/")) else f"./{name}"


def _moved_files(outputs: Outputs, path: Path, scene: Scene) -> tuple[dict[str, str], tuple[Note, ...]]:
    """Return the paths in the root layer that `path` states in another way, as it is in another folder, and a note."""
    from pxr import Ar

    document, folder = scene.document, scene.path.parent
    assert isinstance(document, UsdDocument)  # see `check_source`
    if os.path.realpath(path.parent) == os.path.realpath(folder):
        return {}, ()
    copies, moved, layers = TextureCopies(outputs, path, scene.path), dict[str, str](), list[str]()
    for name in document.names:
        file, inside = Ar.SplitPackageRelativePathOuter(name)
        tiles = _tiles(folder / file)
        found = bool(tiles) or (folder / file).is_file()
        if os.path.isabs(file) or "://" in file or not (file.startswith(".") or found):
            continue  # a place that depends on no folder, or a name that a renderer looks for in its own
        place = copies.tiles(folder / file, tiles) if tiles else copies.name(folder / file)
        moved[name] = _anchored(place) + (f"[{inside}]" if inside else "")
        if moved[name].startswith("../"):
            layers.append(file)
    stay = f"{counted(len(layers), 'file')} {one_or_many(len(layers), 'stays', 'stay')}"
    is_read = f"{stay} in {folder}: {listed(layers)}"
    return moved, (Note(f"{path}: refers to what it is made of where that is: {is_read}"),) if layers else ()


def _tiles(file: Path) -> dict[str, Path]:
    """Return the existing images of a texture with <UDIM> in its name, by the number in the place of that."""
    before, mark, behind = file.name.partition(UDIM)
    if not mark or not file.parent.is_dir():
        return {}
    pattern = re.compile(f"{re.escape(before)}(1[0-9]{{3}}){re.escape(behind)}")
    found = (pattern.fullmatch(name) for name in sorted(os.listdir(file.parent)))
    return {match[1]: file.with_name(match[0]) for match in found if match}


# What the prims get.


def _edit(mesh: MeshWithAo, texture: str, suffix: str, moved: dict[str, str]) -> EditedStage:
    """Return the edited root layer, see `edit_stage`, and messages about polygons."""
    scene, atlas = mesh.scene, mesh.textures[0].atlas
    uvs = None if atlas.uv_set is not None else mesh.uvs.astype(np.float32)
    meshes, cut = _mesh_edits(scene, uvs, mesh.normals, atlas.mapped)
    uses = tuple(_material_use(part, atlas.uv_set) for part in scene.parts)
    baked = BakedTexture(texture, atlas.repeats, _text(mesh))
    size = scene.path.stat().st_size + sum(edit.corners.nbytes for edit in meshes)
    with TemporaryDirectory() as folder:
        edits = StageEdits(meshes, uses, baked, Path(folder) / f"layer{suffix}", moved)
        edited = USD.work(scene.path, size, (scene.path, edits))
    assert isinstance(edited, EditedStage)
    return EditedStage(edited.layer, edited.materials, (*edited.messages, *cut))


def _material_use(part: Part, uv_set: int | None) -> MaterialUse:
    source = part_source(part.source)
    if not part.receives:
        return MaterialUse(source.prim, source.owner, None)
    kept = uv_set is not None and uv_set < len(source.uv_names)
    return MaterialUse(source.prim, source.owner, source.uv_names[uv_set or 0] if kept else NEW_UVS)


def _mesh_edits(
    scene: Scene, uvs: Float32Array | None, normals: Float32Array, mapped: BoolArray
) -> tuple[tuple[MeshEdit, ...], tuple[str, ...]]:
    """Return what each prim gets, and a warning about polygons.

    uvs       (f, 3, 2); None where those of the prims were kept
    normals   (f, 3, 3) that were used
    mapped    (f,) faces with UVs of their own
    Polygons stay whole, so that a corner at which their triangles differ gets the values of one of them.
    """
    parts: dict[str, dict[str, Part]] = {}
    for part in scene.parts:  # of point instances, which are one prim, the first
        parts.setdefault(part_source(part.source).prim, {}).setdefault(part_source(part.source).owner, part)
    shared, cut, edits = _shared_prims(scene), dict[str, int](), list[MeshEdit]()
    corners: Int64Array = np.zeros((len(scene.faces), 3), np.int64)
    for prim, by_owner in parts.items():
        if not any(part.receives for part in by_owner.values()):
            continue
        for part in by_owner.values():
            source = part_source(part.source)
            corners[part.faces] = source.corners[source.polygons.triangles]
            if uvs is not None and (number := _cut_polygons(source.polygons, uvs[part.faces], mapped[part.faces])):
                cut[prim] = cut.get(prim, 0) + number
        faces = np.concatenate([np.arange(part.start, part.stop) for part in by_owner.values()])
        faces = faces[np.argsort(mapped[faces], kind="stable")]  # at one corner, faces with UVs come last, and count
        local = None
        if not all(_has_normals(scene, part, normals) for part in by_owner.values() if part.receives):
            linear = part_source(next(iter(by_owner.values())).source).linear
            local = normalize(normals[faces].reshape(-1, 3) @ linear).astype(np.float32)
        new = None if uvs is None else uvs[faces].reshape(-1, 2)
        edits.append(MeshEdit(prim, prim in shared, corners[faces].reshape(-1), new, local))
    if not cut:
        return tuple(edits), ()
    number, names = sum(cut.values()), listed(list(cut))
    found = f"{counted(number, 'polygon')} of {names} {one_or_many(number, 'has', 'have')} a seam of the UVs inside"
    return tuple(edits), (f"{found}, where the texture is wrong; triangulate the mesh, or write a .glb",)


def _has_normals(scene: Scene, part: Part, normals: Float32Array) -> bool:
    """Tell whether the prim of a part has the normals that were used."""
    own = scene.normals if part_source(part.source).normals else None
    return own is not None and np.array_equal(own[part.faces], normals[part.faces])


def _cut_polygons(polygons: Polygons, uvs: Float32Array, mapped: BoolArray) -> int:
    """Return how many polygons have triangles whose UVs, (t, 3, 2), differ at a corner that they share."""
    triangles, uvs = polygons.triangles[mapped], uvs[mapped]
    at_corner: Float32Array = np.zeros((polygons.counts.sum(), 2), np.float32)
    at_corner[triangles] = uvs
    differs = (np.abs(at_corner[triangles] - uvs) > _EQUAL_WITHIN).any(axis=(1, 2))
    return len(np.unique(polygons.owners[mapped][differs]))


def _shared_prims(scene: Scene) -> set[str]:
    """Return the prims that share texels with other prims, as instances may."""
    shared = set[str]()
    for part in scene.parts:
        if part.uv_owner is not None:
            both = {part_source(one.source).prim for one in (part, scene.parts[part.uv_owner])}
            shared |= both if len(both) > 1 else set()
    return shared


def _text(mesh: MeshWithAo) -> str:
    """Return what the stage and its picture say of the bake."""
    return bake_text(mesh.options, len(mesh.scene.faces), mesh.textures[0].certificate)


# Packages.


def _write_package(
    outputs: Outputs, path: Path, mesh: MeshWithAo, texture: Path
) -> tuple[EditedStage, tuple[Note, ...]]:
    """Write a .usdz: the edited root layer first, then the other files of the source, then the texture."""
    notes: tuple[Note, ...] = ()
    picture = outputs.written(texture).read_bytes()
    if texture.suffix.lower() not in _IN_PACKAGES:
        picture = png_bytes(
            read_image(outputs.written(texture)),
            _text(mesh),
        )
        notes = (Note(f"{path}: a package allows no {texture.suffix} images; it gets a copy as 8-bit PNG"),)
        texture = texture.with_suffix(".png")
    with ZipFile(mesh.scene.path) as package:
        check_unpacked_size(mesh.scene.path, package)
        files = {_name_of(entry): package.read(entry) for entry in package.infolist() if not entry.is_dir()}
    root = next(iter(files))
    names = chain([texture.name], (f"{texture.stem}_{number}{texture.suffix}" for number in count(1)))
    places = (str(PurePosixPath(root).parent / name) for name in names)
    place = next(place for place in places if place not in files)
    edited = _edit(mesh, f"./{PurePosixPath(place).name}", ".usdc" if _is_binary(files[root]) else ".usda", {})
    files |= {root: edited.layer, place: picture}
    outputs.path(path).write_bytes(_package(files.items()))
    return edited, notes


def _name_of(entry: ZipInfo) -> str:
    """Return the name of a file in a package: USD writes UTF-8, but not the flag that says so."""
    if not entry.flag_bits & _UTF8_FLAG:
        with suppress(UnicodeError):
            return entry.filename.encode("cp437").decode()
    return entry.filename


def _package(files: Iterable[tuple[str, bytes]]) -> bytes:
    """Return a ZIP that programs map into memory: no compression, the content of each file at a multiple of 64."""
    made = io.BytesIO()
    with ZipFile(made, "w", ZIP_STORED) as package:
        for name, data in files:
            entry = ZipInfo(name, _FIRST_DATE)
            entry.create_system = 0
            start = made.tell() + 30 + len(name.encode()) + 4  # behind the header, the name and those of the padding
            padding = -start % _ALIGNMENT
            entry.extra = _PADDING_ID.to_bytes(2, "little") + padding.to_bytes(2, "little") + bytes(padding)
            package.writestr(entry, data)
    return made.getvalue()
