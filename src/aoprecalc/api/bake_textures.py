"""The textures of a bake: which faces have which, the bake of each, and all of them as one.

All parts of the scene occlude in the bake of each texture; only the faces that it holds receive.
"""

import re
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from aoprecalc.api.bake_scene import bake_prepared
from aoprecalc.api.bent_normals import scene_tangents
from aoprecalc.api.prepared_scene import prepare_bake
from aoprecalc.api.vertex_ao import fit_to_texture
from aoprecalc.errors import ArgumentError, InputError, counted
from aoprecalc.io.formats.base import source_polygons
from aoprecalc.io.formats.textures import output_uvs
from aoprecalc.io.meshes import grouped
from aoprecalc.options import BakeOptions
from aoprecalc.progress import Note, Progress, StageTimer
from aoprecalc.texture_lookup import TextureStack
from aoprecalc.types import Atlas, Baked, BoolArray, DarkTexels, Float32Array, Float64Array, Int64Array, Scene, Texture
from aoprecalc.uv.checks import RasterizerFactory, needs_uvs
from aoprecalc.uv.tiles import UdimTile, udim_tiles
from aoprecalc.visibility.backend import open_backend
from aoprecalc.visibility.integrand import Integrand
from aoprecalc.visibility.source import LocalVisibility, VisibilityFactory

_MAX_TEXTURES = 1000
_SIZE_OF_CHECK = 1024  # of a texture whose size is not known yet
_MAX_NAME = 60  # characters of the name of a texture


@dataclass(frozen=True, eq=False)
class BakedTexture:
    """One texture of a bake.

    Attributes
    ----------
    name : str
        Of its material, mesh or UDIM tile; empty for the only one of a bake.
    ao, valid : ndarray, (H, W) float32 and bool
        As in `BakeResult`.
    faces : ndarray, (F,) bool
        The faces whose occlusion it holds.
    uvs : ndarray, (F, 3, 2) float64
        The UVs of these faces in it, v upwards; (0, 0) elsewhere.
    """

    name: str
    ao: Float32Array = field(repr=False)
    valid: BoolArray = field(repr=False)
    faces: BoolArray = field(repr=False)
    uvs: Float64Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class TextureBake:
    """The bake of one texture.

    name    of its material, mesh or UDIM tile; empty for the only one of a scene
    baked   its bake, of the scene in which only its faces receive
    """

    name: str
    baked: Baked

    @property
    def faces(self) -> BoolArray:
        """(f,) bool: the faces whose occlusion it holds."""
        return self.baked.scene.receives

    def result(self) -> BakedTexture:
        """Return what Python gets of it."""
        baked, faces = self.baked, self.faces
        uvs = np.where(faces[:, None, None], output_uvs(baked.scene, baked.atlas), 0.0)
        return BakedTexture(self.name, baked.texture.values, baked.texture.valid, faces, uvs)


@dataclass(frozen=True, eq=False)
class BakedTextures:
    """The bakes of all textures of a scene.

    textures   each by itself, at least one; each face has at most one
    whole      all as one bake: the textures are below each other in one, and so are their UVs; of one texture its bake
    """

    textures: tuple[TextureBake, ...]
    whole: Baked

    @property
    def owners(self) -> Int64Array:
        """(f,) index of the texture of each face; -1 where it has none."""
        return _owners(len(self.whole.scene.faces), [texture.faces for texture in self.textures])

    @property
    def named(self) -> tuple[tuple[str, Baked], ...]:
        """The names of the textures, and their bakes."""
        return tuple((texture.name, texture.baked) for texture in self.textures)

    def tangents(self) -> Float32Array:
        """Return the tangents of the faces that have a texture, (f, 3, 4) float32; see `scene_tangents`."""
        tangents: Float32Array = np.zeros((len(self.whole.scene.faces), 3, 4), np.float32)
        for texture in self.textures:
            baked, faces = texture.baked, texture.faces
            tangents[faces] = scene_tangents(baked.scene, baked.atlas, baked.normals)[faces]
        return tangents

    def join(self, values: Sequence[Float32Array]) -> Float32Array:
        """Return values of the textures, each (height, width) or (height, width, channels), as one for `whole`."""
        return values[0] if len(self.textures) == 1 else _stack_of(self.textures, self.owners).join(values)

    def each(self, make: Callable[[Baked, BakeOptions], Float32Array], options: BakeOptions) -> Float32Array:
        """Return what is made of each bake, as one for `whole`."""
        return self.join([make(texture.baked, options) for texture in self.textures])


def bake_textures(
    scene: Scene,
    options: BakeOptions,
    progress: Progress | None = None,
    timer: StageTimer | None = None,
    make_visibility: VisibilityFactory = LocalVisibility,
    high: Sequence[Scene] = (),
) -> BakedTextures:
    """Bake the textures of a scene that the options ask for; raises what `prepare_bake` and `bake_prepared` raise.

    high   see `prepare_bake`
    """
    progress = progress or Progress()
    timer = timer or StageTimer(progress)
    prepared = prepare_bake(scene, options, high)
    scene = prepared.scene
    groups = divide(scene, options)
    with open_backend(options, progress) as backend:
        if options.unwrap in ("auto", "keep"):
            groups = tuple(tile for group in groups for tile in _tiles(backend.rasterizer, scene, group, options))
        if len(groups) == 1:
            baked = bake_prepared(prepared, backend, options, progress, timer, make_visibility)
            return BakedTextures((TextureBake("", baked),), baked)
        own = _of_the_whole(scene, options)
        textures = []
        for group in groups:
            progress.note(f"texture {group.name}: {counted(int(np.count_nonzero(group.faces)), 'triangle')}")
            how = own if group.tile is None else replace(own, unwrap="keep")
            own_scene = replace(prepared, scene=group.scene(scene))
            named = _NamedLines(progress, group.name)
            try:
                baked = bake_prepared(own_scene, backend, how, named, timer, make_visibility, len(groups))
            except InputError as error:
                raise InputError(f"texture {group.name}: {error}") from error
            value = replace(baked.options, max_distance=options.max_distance)
            textures.append(TextureBake(group.name, replace(baked, options=value)))
    whole = _joined(scene, textures)
    if options.vertex_ao != "none":
        with timer.stage("vertices"):
            whole = replace(whole, vertex_ao=fit_to_texture(whole))
    return BakedTextures(tuple(textures), whole)


class _NamedLines(Progress):
    """Passes the notes of one of several textures on, with its name."""

    def __init__(self, progress: Progress, name: str) -> None:
        self._progress, self._name = progress, name

    def advance(self, count: int = 1) -> None:
        """Pass it on."""
        self._progress.advance(count)

    def step(self, text: str) -> None:
        """Pass it on."""
        self._progress.step(text)

    def note(self, text: str) -> None:
        """Pass it on, with the name."""
        self._progress.note(f"{self._name}: {text}")


def _of_the_whole(scene: Scene, options: BakeOptions) -> BakeOptions:
    """Return the options for the bake of one texture of several: shares of the diagonal are of the whole scene.

    Values at vertices are fitted to all textures together.
    """
    distance = options.max_distance
    if isinstance(distance, str):
        distance = Integrand.from_options(options, scene).max_distance
    return replace(options, max_distance=distance, vertex_ao="none")


# Which faces have which texture.


class TextureGroup(NamedTuple):
    """A texture to bake: its name, the faces whose occlusion it holds, (f,) bool, and its UDIM tile, if it is one."""

    name: str
    faces: BoolArray
    tile: UdimTile | None = None

    def scene(self, scene: Scene) -> Scene:
        """Return the scene in which only its faces receive."""
        return replace(scene, baked_only=self.faces) if self.tile is None else self.tile.scene(scene)


def _tiles(
    make_rasterizer: RasterizerFactory, scene: Scene, group: TextureGroup, options: BakeOptions
) -> list[TextureGroup]:
    """Return a texture as one for each UDIM tile of its UVs; itself where they are on none, see `udim_tiles`."""
    size = (options.width, options.height) if options.size != "auto" else (_SIZE_OF_CHECK, _SIZE_OF_CHECK)
    tiles = udim_tiles(make_rasterizer, group.scene(scene), source_polygons(scene).owners, *size)
    before = f"{group.name}." if group.name else ""
    return [TextureGroup(f"{before}{tile.number}", tile.faces, tile) for tile in tiles] or [group]


def divide(scene: Scene, options: BakeOptions) -> tuple[TextureGroup, ...]:
    """Return the textures of a scene: one, or one for each material or mesh that has a surface to bake.

    Parts that share texels have the texture of the part that owns them. Raises ArgumentError for too many.
    """
    if options.textures == "one":
        return (TextureGroup("", scene.receives),)
    names: dict[Hashable, str] = {}
    keys: list[Hashable] = []
    for part in scene.parts:
        owner = part if part.uv_owner is None else scene.parts[part.uv_owner]
        key, name = grouped(scene, owner, options.textures)
        names.setdefault(key, name)
        keys.append(key)
    needed, receives = needs_uvs(scene), scene.receives
    masks = {key: scene.per_face(other == key for other in keys) & receives for key in names}
    used = [key for key, mask in masks.items() if (mask & needed).any()]
    if len(used) > _MAX_TEXTURES:
        kinds = counted(len(used), options.textures, "materials" if options.textures == "material" else "meshes")
        raise ArgumentError("textures", f"is {options.textures}, but {scene.path} has {kinds}; use another")
    return tuple(map(TextureGroup, safe_names([names[key] for key in used]), [masks[key] for key in used]))


def safe_names(names: Iterable[str]) -> list[str]:
    """Return names that files can have everywhere, and that differ whatever the case of their letters.

    Characters but letters, digits, - and _ become _; names that are equal then get a number.
    """
    result: list[str] = []
    taken: set[str] = set()
    for name in names:
        safe = re.sub(r"[^\w-]+", "_", name, flags=re.ASCII).strip("_")[:_MAX_NAME] or "default"
        free, number = safe, 1
        while free.lower() in taken:
            number += 1
            free = f"{safe}_{number}"
        taken.add(free.lower())
        result.append(free)
    return result


# All textures as one bake.


def _owners(faces: int, masks: Sequence[BoolArray]) -> Int64Array:
    owners = np.full(faces, -1)
    for index, mask in enumerate(masks):
        owners[mask] = index
    return owners


def _stack_of(textures: Sequence[TextureBake], owners: Int64Array) -> TextureStack:
    shapes = [texture.baked.texture.valid.shape for texture in textures]
    return TextureStack.of([(height, width) for height, width in shapes], owners, _own_uvs(textures, owners))


def _own_uvs(textures: Sequence[TextureBake], owners: Int64Array) -> Float64Array:
    """Return the UVs of each face in its own texture, (f, 3, 2)."""
    uvs = np.zeros((len(owners), 3, 2))
    for index, texture in enumerate(textures):
        uvs[owners == index] = output_uvs(texture.baked.scene, texture.baked.atlas)[owners == index]
    return uvs


def _joined(scene: Scene, textures: Sequence[TextureBake]) -> Baked:
    """Return the bakes of several textures as one; see `BakedTextures`."""
    bakes = [texture.baked for texture in textures]
    owners = _owners(len(scene.faces), [texture.faces for texture in textures])
    stack, atlases = _stack_of(textures, owners), [baked.atlas for baked in bakes]
    texture = Texture(
        stack.join([baked.texture.values for baked in bakes]),
        stack.join([baked.texture.valid for baked in bakes]),
        stack.join([baked.texture.known for baked in bakes]),
    )
    gutters = [atlas.gutter for atlas in atlases if atlas.gutter is not None]
    uv_sets = {atlas.uv_set for atlas in atlases}
    atlas = Atlas(
        method=" and ".join(dict.fromkeys(atlas.method for atlas in atlases)),
        uvs=stack.move(owners, _own_uvs(textures, owners)),
        mapped=np.any([one.mapped for one in atlases], axis=0),
        charts=sum(one.charts for one in atlases),
        gutter=min(gutters, default=None),
        uv_set=next(iter(uv_sets)) if len(uv_sets) == 1 else None,
    )
    errors = [baked.sampling_error for baked in bakes if baked.sampling_error is not None]
    sizes = [baked.shadow_size for baked in bakes if baked.shadow_size is not None]
    certificates = [baked.certificate for baked in bakes if baked.certificate is not None]
    return replace(
        bakes[0],
        scene=scene,
        texture=texture,
        atlas=atlas,
        directions=max(baked.directions for baked in bakes),
        directions_per_texel=float(np.average([baked.directions_per_texel for baked in bakes], weights=_valid(bakes))),
        sampling_error=max(errors, default=None),
        dark=_dark_of_all(bakes),
        missed=sum(baked.missed for baked in bakes),
        certificate=max(certificates, key=lambda certificate: certificate.bound, default=None),
        shadow_size=max(sizes, default=None),
        size_estimates=(),
        warnings=_told([(texture.name, texture.baked.warnings) for texture in textures]),
        notes=tuple(map(Note, _told([(texture.name, texture.baked.notes) for texture in textures]))),
    )


def _valid(bakes: Sequence[Baked]) -> list[int]:
    """Return how many texels of each bake have a value."""
    return [int(np.count_nonzero(baked.texture.valid)) for baked in bakes]


def _dark_of_all(bakes: Sequence[Baked]) -> DarkTexels:
    weights = _valid(bakes)
    names = ("share", "inside", "inwards", "below_ground", "on_ground", "above_ground", "narrow")
    means = {name: float(np.average([getattr(baked.dark, name) for baked in bakes], weights=weights)) for name in names}
    parts = tuple(part for baked in bakes for part in baked.dark.parts)
    return DarkTexels(**means, samples=sum(baked.dark.samples for baked in bakes), parts=parts)


def _told(lines_of: Sequence[tuple[str, Sequence[str]]]) -> tuple[str, ...]:
    """Return the lines about several textures: those that hold for all once, others with the name of their texture."""
    common = [line for line in lines_of[0][1] if all(line in lines for _, lines in lines_of)]
    own = [f"{name}: {line}" for name, lines in lines_of for line in lines if line not in common]
    return (*dict.fromkeys(common), *own)
