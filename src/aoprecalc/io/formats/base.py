"""What a mesh format is, and what the formats share.

A format is a subclass of `MeshFormat` in a module of this folder, listed once in `aoprecalc.io.meshes.FORMATS`. It
reads a file into a Scene and, where it can hold UVs, writes the Scene back with the UVs, the normals and the texture of
a bake. Formats do not import each other; they share data through `SourceDocument` and `PartSource`.
"""

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from aoprecalc.errors import ArgumentError, UsageError
from aoprecalc.io.formats.files import ColorImages, ImageSource
from aoprecalc.io.formats.polygons import Polygons
from aoprecalc.io.formats.textures import (
    MeshTexture,
    first_uvs,
    part_material,
    split_parts,
    texture_owners,
    textures_uvs,
)
from aoprecalc.io.outputs import Outputs
from aoprecalc.options import Pack, ValueOptions
from aoprecalc.progress import Note
from aoprecalc.texture_lookup import linear_from_srgb
from aoprecalc.types import Atlas, BaseColor, BoolArray, Float32Array, Float64Array, Int64Array, Part, Scene, Wrap


@dataclass(frozen=True, eq=False)
class VertexOcclusion:
    """Ambient occlusion at vertices.

    corners    (f, 3) float32 in [0, 1], equal at one vertex
    as_color   it is to be the colour of the vertices, where they have none
    """

    corners: Float32Array
    as_color: bool = False


@dataclass(frozen=True, eq=False)
class MeshWithAo:
    """A scene with the results of its bake, to be written as a mesh file.

    textures  at least one; each face has at most one of them
    normals   (f, 3, 3) float32, unit length: the shading normals that were used
    pack      "orm": glTF stores occlusion in one image with roughness and metalness where these use the same UVs
    options   those that define the value, to be written beside it; None for none
    strength  of the occlusion, 0 to 1, where the format has one
    vertices  the values at the vertices; None: they are not to be written
    tangents  (f, 3, 4) float32, in the space of the scene, for parts that have none; None: they are not to be written
    """

    scene: Scene
    textures: tuple[MeshTexture, ...]
    normals: Float32Array
    pack: Pack = "none"
    options: ValueOptions | None = None
    strength: float = 1.0
    vertices: VertexOcclusion | None = None
    tangents: Float32Array | None = None

    @cached_property
    def owners(self) -> Int64Array:
        """(f,) index of the texture of each face; -1 where it has none."""
        return texture_owners(self.textures)

    @cached_property
    def uvs(self) -> Float64Array:
        """(f, 3, 2) the UVs of each face in its texture; (0, 0) where it has none."""
        return textures_uvs(self.scene, self.textures)

    @cached_property
    def mapped(self) -> BoolArray:
        """(f,) faces with UVs of their own in their texture; see `Atlas`."""
        mapped: BoolArray = np.zeros(len(self.scene.faces), bool)
        for texture in self.textures:
            mapped |= texture.atlas.mapped & texture.faces
        return mapped

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The parts, each with one texture or none; see `split_parts`."""
        return split_parts(self.scene.parts, self.owners)

    def per_face(self, values: Iterable[bool]) -> BoolArray:
        """Return the value of each face's texture, (f,) bool, from one for each; False where it has none."""
        chosen: BoolArray = np.array([*values, False])[self.owners]
        return chosen

    def only_texture(self, path: Path) -> MeshTexture:
        """Return the one texture; raises UsageError where there are several, which the file at `path` cannot hold."""
        if len(self.textures) > 1:
            found = f"{path}: holds one texture, but the bake has {len(self.textures)}"
            raise UsageError(f"{found}; write a .glb, or bake one with --textures one and new UVs (--unwrap xatlas)")
        return self.textures[0]


@dataclass(frozen=True)
class TextureReference:
    """Where a mesh file refers to its baked texture.

    slot        as the format calls it: occlusionTexture, baseColorTexture, map_Kd, map_Ka, TextureFile
    uvs         as the format calls them: TEXCOORD_1, vt, s and t
    materials   how many refer to it so; None for a format without materials
    packed      the texture also holds their roughness and metalness
    strength    of the occlusion; None where the slot has none
    """

    slot: str
    uvs: str
    materials: int | None = None
    packed: bool = False
    strength: float | None = None


@dataclass(frozen=True)
class WrittenMesh:
    """What was written for a MeshWithAo: where it refers to the texture, and warnings and notes for the user."""

    references: tuple[TextureReference, ...] = ()
    messages: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PartOcclusion:
    """The occlusion texture of one part of a scene, as its file states it.

    image   None where the part has no occlusion texture
    uvs     (n, 3, 2) float64 at the part's corners, v upwards: those of the texture, else the first UV set; None where
            the part has no UVs
    extras  what the mesh's file says of the options of the bake, as JSON; None if nothing
    stated  the file says that it is occlusion; else it may be a picture of colours
    strength  0 to 1: viewers show 1 + strength * (AO - 1)
    """

    image: ImageSource | None
    uvs: Float64Array | None
    extras: object = None
    stated: bool = True
    strength: float = 1.0


@dataclass(frozen=True, eq=False)
class PartSpaces:
    """How the space of a part, and those tangent to it, lie in that of the scene.

    linear          from its own space, (3, 3), or (n, 3, 3, 3) at its corners
    tangents        (n, 3, 4) at its corners, the last is the sign of the bitangent; None: the file has none
    normal_map_uvs  (n, 3, 2) at its corners, v upwards: those of its normal map; None without one
    """

    linear: Float64Array = field(default_factory=lambda: np.eye(3))
    tangents: Float64Array | None = None
    normal_map_uvs: Float64Array | None = None


class MeshFormat(ABC):
    """Reads one kind of mesh file and, optionally, writes it with the results of a bake.

    name           for messages
    extensions     lower case, with the dot
    writes         `write_with_ao` is implemented
    packs_orm      a texture of occlusion, roughness and metalness can be written
    one_uv_set     the format holds one UV set; a baked one replaces those of the file
    alpha          the format holds transparency and alpha masks
    holds_options  the file says how its texture was baked, even where the texture does not
    has_strength   the file says how strong its occlusion is
    holds_vertex_ao   the vertices can have the values of a bake
    holds_tangents    they can have tangents
    holds_textures    its materials can have different baked textures
    holds_directional   they can refer to pictures of bent normals, of these extensions
    """

    name: ClassVar[str]
    extensions: ClassVar[tuple[str, ...]]
    writes: ClassVar[bool] = False
    packs_orm: ClassVar[bool] = False
    one_uv_set: ClassVar[bool] = True
    alpha: ClassVar[bool] = False
    holds_options: ClassVar[bool] = False
    has_strength: ClassVar[bool] = False
    holds_vertex_ao: ClassVar[bool] = False
    holds_tangents: ClassVar[bool] = False
    holds_textures: ClassVar[bool] = False
    holds_directional: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def sniff(self, data: bytes) -> bool:
        """Tell whether the bytes of a file look like this format, whatever the file's name."""

    @abstractmethod
    def read(self, path: Path, data: bytes) -> Scene:
        """Read a file of the given bytes; `path` need not exist, but locates the files that it refers to.

        Raises InputError where the file is damaged or has no usable faces.
        """

    def in_pose(self, scene: Scene, pose: str) -> Scene:
        """Return a scene that was read from this format where an animation stands at a time, and warnings.

        pose   such as walk@0.5
        It has the same faces and corners in the same order, elsewhere, and no document.
        Raises ArgumentError where there is no such animation or time, InputError where it is damaged.
        """
        found = f"is {pose!r}, but {scene.path} is {self.name}" if scene.format else f"is {pose!r}, but this is no file"
        raise ArgumentError("pose", f"{found}, and only glTF has poses; omit it, or convert the model to glTF")

    def referenced_files(self, path: Path, data: bytes) -> list[Path]:
        """Return the files that a file of the given bytes refers to, existing or not."""
        return []

    def source_files(self, scene: Scene) -> list[Path]:
        """Return the files that a scene was read from or refers to; no output may replace them."""
        return [scene.path]

    def output_extension(self, scene: Scene, atlases: Sequence[Atlas]) -> tuple[str, str]:
        """Return the extension of the baked copy of a scene of this format, and why it differs; empty if it does not.

        atlases   of the textures of the bake; none before they are known, when new UVs have to be expected
        """
        if self.writes and len(atlases) > 1 and not self.holds_textures:
            return ".glb", f"{self.name} is written with one texture, so the mesh becomes a GLB with all"
        if self.writes:
            return f".{scene.format}", ""
        return ".glb", f"{self.name} holds no UVs, so the mesh becomes a GLB"

    def check_source(self, path: Path, scene: Scene) -> None:
        """Raise UsageError where a scene, from a file of another format perhaps, cannot be written at `path`."""
        return

    def write_with_ao(self, outputs: Outputs, path: Path, mesh: MeshWithAo) -> WrittenMesh:
        """Write a scene of any format with the UVs, normals and texture of its bake."""
        raise NotImplementedError(f"{self.name} is not written")

    def grouped(self, scene: Scene, part: Part, by: Literal["material", "mesh"]) -> tuple[Hashable, str]:
        """Return what tells the material, or the mesh, of a part from others, and its name; empty where it has none."""
        name = part_material(part) if by == "material" else part.name
        return name, name or ""

    def spaces(self, scene: Scene, part: Part) -> PartSpaces:
        """Return how the spaces of a part lie in that of the scene; raises InputError where the document is damaged."""
        return PartSpaces()

    def object_of(self, part: Part) -> Hashable:
        """Return what tells the object of a part from others: all parts that move together have the same."""
        return part.name

    def occlusion_of(self, scene: Scene, part: Part) -> PartOcclusion:
        """Return the occlusion texture of a part, and its UVs; raises InputError where the document is damaged."""
        return PartOcclusion(None, first_uvs(scene, part))

    def base_colors(self, scene: Scene, images: ColorImages, occlusion: Path | None) -> tuple[BaseColor, ...]:
        """Return the base colour of each part as its file states it; none where the format has no colours.

        images      decodes the textures
        occlusion   the ambient-occlusion texture, which is no base colour wherever the file refers to it
        """
        return ()

    def losses(self, path: Path, mesh: MeshWithAo) -> tuple[str, ...]:
        """Return warnings about what the file at `path`, of this format, cannot hold of a scene."""
        scene, lost = mesh.scene, list[str]()
        source, own = scene.path.name, f".{scene.format}" in self.extensions
        materials = [part.material for part in scene.parts]
        advice = "write a .glb to keep"
        if any(material.transparent or material.alpha_mask is not None for material in materials) and not (
            self.alpha or own
        ):
            lost.append(
                f"{path}: {self.name} holds neither transparency nor alpha masks, which the bake has used; "
                f"{advice} them"
            )
        if self.one_uv_set and scene.uv_sets and any(one.atlas.uv_set != 0 for one in mesh.textures):
            lost.append(f"{path}: {self.name} holds one set of UVs; those of {source} are replaced, {advice} both")
        if own or scene.document is None:
            return tuple(lost)
        if not isinstance(scene.document, SourceDocument):
            lost.append(f"{path}: the materials, nodes and animations of {source} are left out; {advice} them")
        elif any(material.pictured or material.color != WHITE for material in scene.document.materials.values()):
            lost.append(f"{path}: the colours and textures of the materials of {source} are left out; {advice} them")
        if source_colors(scene) is not None:
            lost.append(f"{path}: the colours of the vertices of {source} are left out; {advice} them")
        return tuple(lost)


# What a format can use of a file of another format.


@dataclass(frozen=True)
class Placement:
    """How a texture lies on UVs, v upwards: they are multiplied by `scale`, then `offset` is added.

    wrap   beyond [0, 1], along both axes
    """

    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)
    wrap: Wrap = "repeat"

    def transform(self, uvs: Float64Array) -> Float64Array:
        """Return (..., 2) UVs of the texture."""
        return uvs * self.scale + self.offset


WHITE = (1.0, 1.0, 1.0)
AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]  # as in glTF


@dataclass(frozen=True)
class SourceMaterial:
    """The diffuse colour (red, green, blue, 0 to 1, sRGB), diffuse texture and opacity of a material.

    placement        of its textures
    opacity          0 to 1
    opacity_map      the image that it is multiplied by: `texture`, for its alpha, or another; None where it has none
    opacity_channel  of that image: see `opacity_of`
    alpha_mode       MASK: holes where the opacity map is below 0.5
    emission         the colour that it emits, as `color`
    roughness        0 to 1
    metalness        0 to 1
    double_sided     its back is drawn, too
    left_out         what else it has and glTF does not get, for a warning
    """

    name: str
    color: tuple[float, float, float] = WHITE
    texture: ImageSource | None = None
    placement: Placement = field(default_factory=Placement)
    opacity: float = 1.0
    opacity_map: ImageSource | None = None
    opacity_channel: str = ""
    alpha_mode: AlphaMode = "OPAQUE"
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roughness: float = 1.0
    metalness: float = 0.0
    double_sided: bool = False
    left_out: tuple[str, ...] = ()

    @property
    def pictured(self) -> bool:
        """Whether it has textures that need the UVs of its file."""
        return self.texture is not None or self.opacity_map is not None

    def factor(self, *, textured: bool) -> tuple[float, float, float]:
        """Return the linear colour, by which a texture is multiplied; some programs write black for white there."""
        red, green, blue = linear_from_srgb(np.array(self.color)).tolist()
        return (red, green, blue) if any(self.color) or not textured else (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class SourceDocument:
    """What a reader keeps of its file, for writing it back.

    polygons    the file's polygons, which were cut into the scene's triangles
    materials   by name
    frame       notes on a unit and axes that differ from those of glTF, metres and Y up: numbers are kept
    """

    polygons: Polygons
    materials: Mapping[str, SourceMaterial]
    frame: tuple[Note, ...] = field(default=(), kw_only=True)

    def colors(self, scene: Scene) -> Float32Array | None:
        """Return the linear colours at the corners of its faces, (f, 3, 3) or with alpha (f, 3, 4); None without."""
        return None


def source_polygons(scene: Scene) -> Polygons:
    """Return the polygons of a scene's file, or else its triangles."""
    document = scene.document
    return document.polygons if isinstance(document, SourceDocument) else Polygons.of_triangles(len(scene.faces))


def source_materials(scene: Scene) -> Mapping[str, SourceMaterial]:
    """Return the materials of a scene's file by name."""
    return scene.document.materials if isinstance(scene.document, SourceDocument) else {}


def source_colors(scene: Scene) -> Float32Array | None:
    """Return the linear colours at the corners of a scene's faces, (f, 3, 3 or 4); None where its file has none."""
    return scene.document.colors(scene) if isinstance(scene.document, SourceDocument) else None


def source_frame(scene: Scene) -> tuple[Note, ...]:
    """Return notes on the unit and axes of a scene's file."""
    return scene.document.frame if isinstance(scene.document, SourceDocument) else ()
