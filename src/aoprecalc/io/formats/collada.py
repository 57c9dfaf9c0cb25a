"""COLLADA (.dae, .zae), by pycollada: the geometry of every instance, in the world, with its materials."""

import posixpath
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from html import unescape
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any, Self
from urllib.parse import unquote
from xml.etree.ElementTree import Element
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from aoprecalc.errors import InputError
from aoprecalc.io.formats.archives import check_unpacked_size
from aoprecalc.io.formats.base import SourceDocument, SourceMaterial
from aoprecalc.io.formats.builder import MeshPiece, build_scene, check_indices, cofactors
from aoprecalc.io.formats.files import ImageSource
from aoprecalc.io.formats.materials import ExaminedMaterial, PicturedFormat, examine, picture_search
from aoprecalc.io.formats.polygons import Polygons, corner_order, polygon_triangles
from aoprecalc.io.formats.textures import PartSource
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import LUMINANCE, linear_from_srgb
from aoprecalc.types import Float64Array, Int64Array, Material, Scene

_MAX_NODES = 100_000  # instances of nodes multiply: a few kilobytes may be more than memory
_MAX_TOLD = 3  # errors of pycollada that are passed on
# What is not read: words for it -> how it begins in the XML.
_LEFT_OUT = {
    "animations": rb"animation\b",
    "skins and morphs": rb"instance_controller\b",
    "colours of vertices": rb'input\b[^>]*semantic="COLOR"',
    "cameras": rb"camera\b",
    "lights": rb"light\b",
}
_IMAGE = re.compile(rb"<(?:\w+:)?image\b")
_INIT_FROM = re.compile(rb"<(?:\w+:)?init_from\b[^<>]*>\s*(?:<(?:\w+:)?ref>)?([^<]*)")
# Of an effect: its pictures that are named in a warning.
_OTHER_PICTURES = ("emission", "ambient", "specular", "reflective", "bumpmap")


class ColladaFormat(PicturedFormat):
    """COLLADA, plain or zipped."""

    name = "COLLADA"
    extensions = (".dae", ".zae")

    def sniff(self, data: bytes) -> bool:
        """Tell whether there is a COLLADA element, or a ZIP with a .dae in it."""
        return b"<COLLADA" in data[:4096] or (data.startswith(b"PK") and b".dae" in data)

    def read(self, path: Path, data: bytes) -> Scene:
        """Read every instance of every mesh, by material; raises InputError where pycollada is missing."""
        if find_spec("collada") is None:
            raise InputError(f"{path}: COLLADA needs the package pycollada; `pip install 'aoprecalc[formats]'`")
        package = _Package.of(path, data)
        return _Reader(path, package.text, _Pictures(path, package)).read()

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the pictures that it names, without those in its archive."""
        package = _Package.of(path, data)
        pictures = _Pictures(path, package)
        names = (_INIT_FROM.search(image) for image in _IMAGE.split(package.text)[1:])
        found = (pictures.find(unescape(name[1].decode("utf-8", "surrogateescape"))) for name in names if name)
        return [picture.path for picture in found if picture is not None and picture.path is not None]


@dataclass(frozen=True)
class _Package:
    """A document, its name in its archive, and the files there; no names and files where it is in none."""

    text: bytes
    name: str = ""
    files: Mapping[str, bytes] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path, data: bytes) -> Self:
        """Unpack a file of the given bytes; raises InputError where its content is too large."""
        if not data.startswith(b"PK"):
            return cls(data)
        with ZipFile(BytesIO(data)) as archive:
            check_unpacked_size(path, archive)
            files = {name: archive.read(name) for name in archive.namelist()}
        name = next((name for name in files if name.lower().endswith(".dae")), "")
        return cls(files.get(name, b""), name, files)


@dataclass(frozen=True)
class ColladaPart(PartSource):
    """The faces of an instance that have one material: its polygons, whose triangles are those of the part."""

    polygons: Polygons = field(default_factory=lambda: Polygons.of_triangles(0))


@dataclass(frozen=True)
class _Instance:
    """A geometry in the world: its materials by symbol, and the names of the nodes above it, the nearest first."""

    geometry: Any
    matrix: Float64Array
    materials: Mapping[str, Any]
    names: tuple[str, ...]


class _Reader:
    """Reads one document."""

    def __init__(self, path: Path, text: bytes, pictures: "_Pictures") -> None:
        """Parse it."""
        from collada import Collada
        from collada.common import DaeError

        self._path, self._text = path, text
        self._document = Collada(BytesIO(text), ignore=[DaeError])
        self._pictures = pictures
        self._materials: dict[str, ExaminedMaterial[SourceMaterial]] = {}
        self._names: dict[str, str] = {}  # by id
        self._visited = 0

    def read(self) -> Scene:
        """Return the scene."""
        scene, asset = self._document.scene, self._document.assetInfo
        instances = [] if scene is None else [found for node in scene.nodes for found in self._instances(node)]
        pieces = [piece for instance in instances for piece in self._pieces(instance)]
        polygons = [piece.source.polygons for piece in pieces if isinstance(piece.source, ColladaPart)]
        materials = {name: found.material for name, found in self._materials.items()}
        document = SourceDocument(Polygons.concatenate([Polygons.of_triangles(0), *polygons]), materials)
        up = str(asset.upaxis or "Y_UP")[0].lower()
        unit = float(asset.unitmeter or 1)
        made = build_scene(
            self._path, self._path.suffix.lower()[1:], pieces, document, [*self._messages(), *_frame(up, unit)]
        )
        return replace(made, up="z" if up == "z" else "y" if up == "y" else None, unit=unit if unit > 0 else None)

    def _messages(self) -> Iterator[str]:
        for error in self._document.errors[:_MAX_TOLD]:
            yield f"{self._path}: {' '.join(str(error).split())[:160]}; it is left out"
        for examined in self._materials.values():
            yield from examined.messages
        if lost := [words for words, start in _LEFT_OUT.items() if re.search(rb"<(?:\w+:)?" + start, self._text)]:
            yield f"{self._path}: COLLADA is read without {', '.join(lost)}, which it has; export it as glTF"

    # Geometry.

    def _instances(
        self, node: Any, above: Float64Array | None = None, names: tuple[str, ...] = ()
    ) -> Iterator[_Instance]:
        """Yield the geometries of a node and those below it; of a skin or morph the shape to which it is bound."""
        from collada import scene as kinds

        self._visited += 1
        if self._visited > _MAX_NODES:
            raise InputError(f"{self._path}: more than {_MAX_NODES:,} nodes; use a smaller scene")
        above = np.eye(4) if above is None else above
        if isinstance(node, kinds.NodeNode):
            yield from self._instances(node.node, above, names)
        elif isinstance(node, kinds.Node):
            name = _name(node)
            names = (name, *names) if name else names
            for child in node.children:
                yield from self._instances(child, above @ np.array(node.matrix, np.float64), names)
        elif isinstance(node, kinds.GeometryNode):
            yield _Instance(node.geometry, above, {used.symbol: used for used in node.materials}, names)
        elif isinstance(node, kinds.ControllerNode):
            matrix, shape = above, node.controller
            if hasattr(shape, "bind_shape_matrix"):  # the joints place a skin, not its node
                matrix, shape = np.array(shape.bind_shape_matrix, np.float64), shape.geometry
            shape = getattr(shape, "source_geometry", shape)
            yield _Instance(shape, matrix, {used.symbol: used for used in node.materials}, names)

    def _pieces(self, instance: _Instance) -> Iterator[MeshPiece]:
        from collada.lineset import LineSet

        for primitive in instance.geometry.primitives:
            if not isinstance(primitive, LineSet) and primitive.vertex_index is not None and len(primitive):
                yield self._piece(instance, primitive)

    def _piece(self, instance: _Instance, primitive: Any) -> MeshPiece:
        linear = instance.matrix[:3, :3]
        mirrored = bool(np.linalg.det(linear) < 0)
        points: Float64Array = np.array(primitive.vertex, np.float64).reshape(-1, 3)
        positions = points @ linear.T + instance.matrix[:3, 3]
        indices: Int64Array = np.array(primitive.vertex_index, np.int64).reshape(-1)
        counts: Int64Array = np.array(getattr(primitive, "vcounts", np.full(len(indices) // 3, 3)), np.int64)
        check_indices(self._path, indices, len(positions))
        order = corner_order(counts, mirrored)
        polygons = Polygons(counts, *polygon_triangles(counts, indices[order], positions))
        at = order[polygons.triangles]
        normals = _at_corners(primitive.normal, primitive.normal_index, at, 3)
        if normals is not None:
            normals = normals @ cofactors(linear).T * (-1 if mirrored else 1)

        binding = instance.materials.get(primitive.material)
        name = None if binding is None or binding.target is None else self._material(binding.target)
        uv_sets = self._uv_sets(primitive, binding, at)
        material = Material() if name is None else self._materials[name].at(uv_sets[0] if uv_sets else None)
        shape = instance.geometry.name or instance.geometry.id
        names = [*instance.names[1:], str(shape), name]
        title = instance.names[0] if instance.names else str(shape)
        return MeshPiece(title, positions, indices[at], normals, uv_sets, ColladaPart(name, polygons), names, material)

    def _uv_sets(self, primitive: Any, binding: Any, at: Int64Array) -> tuple[NDArray[Any], ...]:
        """Return the UVs at corners, those of the material's picture first."""
        inputs = primitive.sources.get("TEXCOORD", ())
        sets = [
            _at_corners(values, indices, at, 2)
            for values, indices in zip(primitive.texcoordset, primitive.texcoord_indexset, strict=True)
        ]
        effect = None if binding is None or binding.target is None else binding.target.effect
        texture = next((each for each in _pictures_of(effect) if _is_texture(each)), None)
        if texture is not None:
            wanted = next((number for name, _, number in binding.inputs if name == texture.texcoord), None)
            first = next((place for place, given in enumerate(inputs) if given[3] == (wanted or "0")), 0)
            sets = [*sets[first : first + 1], *sets[:first], *sets[first + 1 :]]
        return tuple(uvs for uvs in sets if uvs is not None)

    # Materials.

    def _material(self, material: Any) -> str:
        """Return the name by which a material is known, after it was read."""
        number = str(material.id)
        if number not in self._names:
            name = str(material.name or number)
            self._names[number] = name if name not in self._materials else number
            source = self._source(self._names[number], material.effect)
            own_alpha = _parameter(material.effect, "transparent").find("{*}texture") is None
            advice = "name it in its <transparent> to make it so"
            self._materials[self._names[number]] = examine(source, own_alpha=own_alpha, advice=advice)
        return self._names[number]

    def _source(self, name: str, effect: Any) -> SourceMaterial:
        """Return the colours and pictures of an effect of the common profile."""
        color, holes = (effect.diffuse, effect.transparent)
        image, mask = self._image(color), self._image(holes)
        mode = _parameter(effect, "transparent").get("opaque", "A_ONE")
        channel = {"A_ONE": "alpha", "RGB_ONE": "luminance"}.get(mode, "transparency")
        left_out = [
            f"the {slot} picture of {name}" for slot in _OTHER_PICTURES if _is_texture(getattr(effect, slot, None))
        ]
        red, green, blue = _color(color, (1.0, 1.0, 1.0)) if image is None else (1.0, 1.0, 1.0)
        glow = _color(effect.emission, (0.0, 0.0, 0.0))
        return SourceMaterial(
            name,
            (red, green, blue),
            image,
            opacity=1.0 if mask else _opacity(effect, mode),
            opacity_map=mask or image,
            opacity_channel=channel if mask else "alpha",
            emission=glow,
            double_sided=bool(effect.double_sided),
            left_out=tuple(left_out),
        )

    def _image(self, value: Any) -> ImageSource | None:
        return self._pictures.find(value.sampler.surface.image.path) if _is_texture(value) else None


class _Pictures:
    """The pictures of a document: in its archive, else beside it."""

    def __init__(self, path: Path, package: _Package) -> None:
        """Look into the archive, and into the folders where packs of assets have them."""
        self._search, self._files = picture_search(path), package.files
        self._folder = posixpath.dirname(package.name)
        self._by_path = {name.casefold(): name for name in package.files}
        counts = Counter(map(posixpath.basename, self._by_path))
        self._by_name = {
            name: file for path, file in self._by_path.items() if counts[name := posixpath.basename(path)] == 1
        }

    def find(self, uri: str) -> ImageSource | None:
        """Return the picture that a document names; at its place, where there is none."""
        name = re.sub(r"^file:(//)?(/(?=[A-Za-z]:))?", "", uri.strip())
        inside = self._inside(unquote(name).replace("\\", "/").casefold())
        if inside is not None:
            return ImageSource(inside, data=self._files[inside])
        place = self._search.place(name)
        return None if place is None else ImageSource.of(place)

    def _inside(self, name: str) -> str | None:
        """Return the file of the archive that a name means: by its path from the document, else the only one called so.

        name   in lower case
        """
        path = posixpath.normpath(posixpath.join(self._folder.casefold(), name))
        return self._by_path.get(path) or self._by_name.get(posixpath.basename(name))


def _frame(up: str, unit: float) -> Iterator[Note]:
    """Yield notes on units and axes that differ from those of the GLB, metres and Y up: numbers are kept."""
    if unit != 1:
        yield Note(f"its unit is {unit:g} metres; its numbers are kept, and a GLB calls them metres")
    if up != "y":
        yield Note(f"its axis {up.upper()} points up; its numbers are kept, and in a GLB Y points up")


def _name(node: Any) -> str:
    """Return the name of a node, else its id; empty where it has neither."""
    element = node.xmlnode
    return str(element.get("name") or element.get("id") or "")


def _at_corners(values: Any, indices: Any, at: Int64Array, size: int) -> NDArray[Any] | None:
    """Return values at the corners of triangles, (t, 3, size), NaN for missing ones; None where there are none."""
    if values is None or indices is None or not len(values):
        return None
    table: Float64Array = np.array(values, np.float64)
    table = table.reshape(len(table), -1)[:, :size]
    chosen = np.array(indices, np.int64).reshape(-1)[at]
    is_there = (chosen >= 0) & (chosen < len(table))
    return np.where(is_there[..., None], table[np.where(is_there, chosen, 0)], np.nan)


def _is_texture(value: Any) -> bool:
    return hasattr(value, "sampler")


def _pictures_of(effect: Any) -> tuple[Any, ...]:
    return () if effect is None else (effect.diffuse, effect.transparent)


def _color(value: Any, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a colour of an effect, sRGB in [0, 1]; the default for a texture, or none."""
    if value is None or _is_texture(value):
        return default
    red, green, blue = (min(max(float(component), 0.0), 1.0) for component in [*value][:3])
    return red, green, blue


def _parameter(effect: Any, name: str) -> Any:
    """Return the element of a parameter of an effect; an empty one where it has none."""
    found = next((each for each in effect.xmlnode.iter() if str(each.tag).endswith(f"}}{name}")), None)
    return Element(name) if found is None else found


def _opacity(effect: Any, mode: str) -> float:
    """Return the opacity of an effect without a picture of it, by `transparent`, `transparency` and what these mean.

    pycollada gives a missing transparency another value than the specification, 1.
    """
    text = next((each.text for each in _parameter(effect, "transparency").iter() if str(each.tag).endswith("float")), 1)
    factor = float(text or 1)
    color = effect.transparent if not _is_texture(effect.transparent) else None
    is_alpha = mode.startswith("A")
    if color is None or _parameter(effect, "transparent").tag == "transparent":
        value = 1.0 if is_alpha else 0.0
    elif is_alpha:
        value = float(color[3])
    else:
        value = float(linear_from_srgb(np.clip(color[:3], 0, 1)) @ LUMINANCE)
    kept = value * factor
    return float(np.clip(kept if mode in ("A_ONE", "RGB_ONE") else 1 - kept, 0, 1))
