"""An occlusion texture on its mesh: the faces that it covers, and how it was baked.

`verify` and `compare` measure it (TexturedSurface), pictures show it (MeshToDraw).
"""

import os
import shlex
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from aoprecalc.api.mesh import Mesh, MeshLike, as_mesh
from aoprecalc.errors import AoprecalcError, ArgumentError, InputError, UsageError, counted, one_or_many, option_name
from aoprecalc.io import IMAGE_EXTENSIONS, OcclusionTexture, find_occlusion, source_files, texture_values
from aoprecalc.io.formats.textures import output_uvs
from aoprecalc.io.meshes import base_colors
from aoprecalc.io.occlusion import Misfit, NoOcclusionError, baked_copy, every_occlusion, join_occlusion, mesh_beside
from aoprecalc.mesh.roles import assign_roles, finest_level, names_a_part, up_axis
from aoprecalc.mesh.surface import face_normals, shading_normals
from aoprecalc.metrics.errors import seam_difference
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.options.fields import option_fields, with_files
from aoprecalc.progress import Note
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import atlas_from_uvs, build_layout
from aoprecalc.types import Atlas, Baked, BoolArray, Certificate, Float32Array, Float64Array, Scene, TexturedMesh

# A given texture is refused beyond this share of random differences across seams. Measured: 0.07 to 0.65 with the right
# textures, 0.75 to 1.2 with those of other meshes; with few seams, or hardly any contrast, nothing can be told.
_MAX_SEAM_RATIO, _MIN_SEAMS, _MIN_CONTRAST = 0.85, 100, 0.05


@dataclass(frozen=True, eq=False)
class TexturedSurface:
    """A texture on its mesh.

    scene      with the roles of its parts
    picture    the texture
    mapped     (f,) bool: the faces that it covers: some, all of them with area
    options    what its values should be: the options that were given, else those of the bake, else the defaults
    taken      the words of a command line for what was taken from the bake and is no default
    warnings   for the user
    """

    scene: Scene
    picture: OcclusionTexture
    mapped: BoolArray
    options: ValueOptions
    taken: tuple[str, ...]
    warnings: tuple[str, ...]

    @classmethod
    def of(cls, scene: Scene, picture: OcclusionTexture, given: VerifyOptions) -> "TexturedSurface":
        """Return a texture on its mesh, with the options of its bake where `given` does not say others.

        Raises UsageError where options contradict each other or name no part, InputError where the texture covers none
        of the faces.
        """
        baked, missing = _known_parts(scene, picture.options, picture.name, given)
        options = given.value_options(baked)
        scene = assign_roles(scene, options)
        mapped, left_out = _mapped(scene, picture)
        taken = () if baked is None else verify_words(options, given)
        return cls(scene, picture, mapped, options, taken, (*picture.warnings, *missing, *left_out))

    @property
    def certificate(self) -> Certificate | None:
        """The certificate of its bake; None where it has none, did not reach it, or other options are given now."""
        certificate, baked = self.picture.certificate, self.picture.options
        if certificate is None or not certificate.holds or baked is None:
            return None
        same = with_files(self.options, os.path.basename) == with_files(baked, os.path.basename)
        return certificate if same else None

    @property
    def warning_on_mesh(self) -> tuple[str, ...]:
        """A warning where the texture says that it was baked for another mesh; else nothing."""
        baked, found = self.picture.triangles, len(self.scene.faces)
        if baked in (None, found):
            return ()
        one, other = counted(baked or 0, "triangle"), counted(found, "triangle")
        whose = f"{self.picture.name}: was baked for a mesh of {one}, but {self.scene.path} has {other}"
        return (f"{whose}; pass the texture of this mesh, or the mesh of this texture",)

    @property
    def note_on_strength(self) -> tuple[Note, ...]:
        """A note where viewers weaken the texture, as its file says, while the picture itself is measured."""
        strengths = _strengths(self.picture, self.mapped)
        found = f"{self.picture.name}: has a strength of {strengths}, which viewers apply"
        return (Note(f"{found}; the picture itself is measured"),) if strengths else ()

    @cached_property
    def atlas(self) -> Atlas:
        """Its UVs with their charts, which takes longer to find than a picture to draw."""
        return atlas_from_uvs(self.scene, self.picture.uvs, self.mapped)

    def coverage(self) -> BoolArray:
        """Return the texels of the texture that the surface covers at least in part, (height, width) bool."""
        height, width = self.picture.values.shape
        covered: BoolArray = np.zeros(height * width, bool)
        covered[CPURasterizer(build_layout(self.scene, self.atlas, width, height)).coverage().index] = True
        return covered.reshape(height, width)

    def overlap(self) -> float:
        """Return the share of the covered texels that lie inside two triangles; not those that instances share."""
        owners = assign_roles(self.scene, self.options, share=True).parts
        mapped = self.mapped & self.scene.per_face(part.uv_owner is None for part in owners)
        height, width = self.picture.values.shape
        return CPURasterizer(build_layout(self.scene, replace(self.atlas, mapped=mapped), width, height)).overlap()


def _strengths(picture: OcclusionTexture, mapped: BoolArray) -> str:
    """Return the strengths of a texture, where one is not 1; else nothing."""
    strengths = [1] if picture.strengths is None else np.unique(picture.strengths[mapped]).tolist()
    return "" if strengths == [1] else " or ".join(f"{strength:g}" for strength in strengths)


def misfit(scene: Scene, given: VerifyOptions) -> Misfit:
    """Return how badly a texture fits the parts that are to have one: 0 all show it, 1 some, 2 none.

    Which parts these are is as in `TexturedSurface.of`, so it depends on the options of the texture's bake.
    """

    def rank(shown: BoolArray, baked: ValueOptions | None) -> int:
        try:
            receives = assign_roles(scene, given.value_options(_known_parts(scene, baked, "", given)[0])).receives
        except AoprecalcError:  # these options leave no part
            return 2
        return 0 if shown[receives].all() else 1 if shown[receives].any() else 2

    return rank


def _known_parts(
    scene: Scene, baked: ValueOptions | None, texture: str, given: VerifyOptions
) -> tuple[ValueOptions | None, tuple[str, ...]]:
    """Return the options of the bake, with names of parts only that the file still has, and warnings about others."""
    if baked is None:
        return None, ()
    known: dict[str, Any] = {}
    warnings = []
    for argument in ("only", "exclude", "occluders_only"):
        if getattr(given, argument) is not None:
            continue
        known[argument] = tuple(name for name in getattr(baked, argument) if names_a_part(scene.parts, name))
        warnings += [
            f"{texture} was baked with {option_name(argument)} {name!r}, which is not the name of a part of "
            f"{scene.path}; it is left out"
            for name in getattr(baked, argument)
            if name not in known[argument]
        ]
    return replace(baked, **known), tuple(warnings)


def verify_words(options: ValueOptions, given: VerifyOptions) -> tuple[str, ...]:
    """Return the words with which `verify` gets the options that were not given and differ from their defaults."""
    words = list[str]()
    for field in option_fields(VerifyOptions):
        used = getattr(options, field.name, None)  # None too for what does not define the value
        if getattr(given, field.name) is None and used is not None and used != getattr(ValueOptions, field.name):
            words += field.words(used)
    return tuple(words)


def _mapped(scene: Scene, picture: OcclusionTexture) -> tuple[BoolArray, tuple[str, ...]]:
    """Return the faces that a texture covers, (f,) bool, and warnings about the others.

    A face whose corners share one UV is not mapped: files without UVs for some faces have (0, 0) there.
    """
    has_area = face_normals(scene.corners)[1]
    has_uvs = np.isfinite(picture.uvs).all(axis=(1, 2)) & (picture.uvs != picture.uvs[:, :1]).any(axis=(1, 2))
    mapped = picture.shown & scene.receives & has_area & has_uvs
    if not mapped.any():
        raise InputError(
            f"{scene.path}: none of {counted(len(scene.faces), 'face')} has area and UVs in {picture.name}; "
            "bake it, or export it with UVs"
        )
    wanted, faces = scene.receives & has_area, counted(len(scene.faces), "face")
    warnings = list[str]()
    if (elsewhere := np.count_nonzero(wanted & ~picture.shown)) > 0:
        found = f"other textures ({', '.join(picture.others)})" if picture.others else "no such texture"
        left_out = one_or_many(elsewhere, "is left out: its material has", "are left out: their materials have")
        warnings.append(f"{elsewhere} of {faces} {left_out} {found}")
    if (without := np.count_nonzero(wanted & picture.shown & ~has_uvs)) > 0:
        have, are = one_or_many(without, "has", "have"), one_or_many(without, "is", "are")
        warnings.append(f"{without} of {faces} {have} no UVs in the texture and {are} left out")
    return mapped, tuple(warnings)


def find_texture(
    mesh: Mesh, texture: str | PathLike[str] | ArrayLike | None, options: VerifyOptions, *, whole: bool = True
) -> OcclusionTexture:
    """Return a texture of a mesh, with its UVs and the options of its bake: see `verify`, and `find_occlusion`."""
    scene = mesh._scene
    if isinstance(texture, str | PathLike):
        return find_occlusion(scene, Path(texture))
    if texture is not None:
        return find_occlusion(scene, texture_values("texture", texture))
    if mesh.ao is not None:
        return replace(find_occlusion(scene, mesh.ao), options=mesh._options)
    if not scene.format:
        raise ArgumentError("texture", "is None and the mesh is not from a file; expected an array or a path")
    return find_occlusion(scene, misfit=misfit(scene, options), whole=whole)


# As pictures show it.


@dataclass(frozen=True, eq=False)
class MeshToDraw:
    """A mesh with its texture as pictures show it, and where both come from.

    mesh      the mesh; without a texture where it has none
    name      stem of the names of files
    texture   name of the texture; None without one
    picture   its file; None where it is in the mesh's file, in memory, or missing
    up        the axis that points up, x, y or z
    files     that were read: no output may replace them
    messages  notes and warnings for the user
    all_parts levels of detail and collision hulls are drawn as ordinary parts
    """

    mesh: TexturedMesh
    name: str
    texture: str | None
    picture: Path | None
    up: Literal["x", "y", "z"]
    files: tuple[Path, ...] = ()
    messages: tuple[str, ...] = ()
    all_parts: bool = False


def mesh_to_draw(
    mesh: MeshLike | Baked, texture: str | PathLike[str] | ArrayLike | None = None, *, colors: bool = False
) -> MeshToDraw:
    """Find the texture of a mesh, and return both as pictures show them.

    mesh      a mesh, the path of its file or of the picture beside it, as a bake writes them, or a bake
    texture   a picture or values (h, w), for any mesh with UVs; None: the mesh's own, else none and a note on how to
              bake it. A picture with colours that the mesh refers to is no ambient occlusion, unless glTF says that
              it is
    colors    decode the base colours of its materials, too
    Raises ArgumentError, UsageError and InputError as `verify` does.
    """
    found = _baked_to_draw(mesh) if isinstance(mesh, Baked) else _find(mesh, texture)
    if not found.all_parts:
        found = _at_finest_level(found)
    return _with_colors(found) if colors else found


def _find(mesh: MeshLike, texture: str | PathLike[str] | ArrayLike | None) -> MeshToDraw:
    if isinstance(mesh, str | PathLike) and Path(mesh).suffix.lower() in IMAGE_EXTENSIONS:
        mesh, texture = _mesh_of(Path(mesh)), mesh if texture is None else texture
    mesh = as_mesh(mesh)
    scene = mesh._scene
    try:
        surface = TexturedSurface.of(scene, _own_or_given(mesh, texture), VerifyOptions())
    except NoOcclusionError:
        if texture is not None:
            raise
        return _without_texture(mesh)
    picture = surface.picture
    if texture is not None:
        _check_that_it_belongs(surface, mesh)
    shown = TexturedMesh(
        scene=surface.scene,
        normals=_normals(surface.scene, surface.options),
        uvs=np.where(np.isfinite(picture.uvs), picture.uvs, 0.0),
        ao=picture.values,
        textured=surface.mapped,
        strengths=picture.strengths,
    )
    strengths = _strengths(picture, surface.mapped)
    drawn = [Note(f"{picture.name}: is drawn with its strength of {strengths}, as in viewers")] if strengths else []
    about_texture = (*map(Note, surface.warnings), *drawn, *_note_on_uv_set(surface, texture))
    messages = (*scene.notes, *scene.warnings, *about_texture, *surface.warning_on_mesh)
    up = up_axis(scene, surface.options)
    files, all_parts = _files(scene, picture.path), surface.options.all_parts
    return MeshToDraw(shown, mesh.name, picture.name, picture.path, up, files, messages, all_parts)


def _at_finest_level(found: MeshToDraw) -> MeshToDraw:
    """Leave out collision hulls and coarser levels of detail."""
    mesh = found.mesh
    scene, kept = finest_level(mesh.scene)
    if kept.all():
        return found
    uvs = None if mesh.uvs is None else mesh.uvs[kept]
    strengths = None if mesh.strengths is None else mesh.strengths[kept]
    finest = replace(
        mesh, scene=scene, normals=mesh.normals[kept], uvs=uvs, textured=mesh.textured[kept], strengths=strengths
    )
    left_out = counted(len(mesh.scene.parts) - len(scene.parts), "part")
    note = Note(f"{scene.path}: {left_out} not drawn, as collision hulls or coarser levels of detail")
    return replace(found, mesh=finest, messages=(*found.messages, note))


def _files(scene: Scene, texture: Path | None = None) -> tuple[Path, ...]:
    return (*source_files(scene), *(() if texture is None else (texture,)))


def _with_colors(found: MeshToDraw) -> MeshToDraw:
    colors, warnings = base_colors(found.mesh.scene, found.picture)
    return replace(found, mesh=replace(found.mesh, base_colors=colors), messages=(*found.messages, *warnings))


def _mesh_of(picture: Path) -> Path:
    """Return the mesh beside a picture, as a bake writes them; raises UsageError where there is none."""
    if not picture.is_file():
        raise InputError(f"{picture}: there is no such file, a mesh or its texture was expected; check the path")
    mesh = mesh_beside(picture)
    if mesh is None:
        raise UsageError(f"{picture}: is a picture, and no mesh is beside it; name the mesh, and it with --texture")
    return mesh


def _own_or_given(mesh: Mesh, texture: str | PathLike[str] | ArrayLike | None) -> OcclusionTexture:
    """Return the texture to show; raises NoOcclusionError where none is given and the mesh has none."""
    if texture is not None:
        return find_texture(mesh, texture, VerifyOptions())
    if mesh.ao is None and not mesh._scene.format:
        raise NoOcclusionError(f"{mesh.name}: has no ambient occlusion; bake it")
    picture = find_texture(mesh, None, VerifyOptions(), whole=False)
    return join_occlusion(every_occlusion(mesh._scene), picture) if picture.others else picture


def _note_on_uv_set(surface: TexturedSurface, texture: object) -> tuple[Note, ...]:
    """Note which of several UV sets a texture that was given is drawn on."""
    sets, uvs = surface.scene.uv_sets, np.nan_to_num(surface.picture.uvs)
    if texture is None or len(sets) < 2:
        return ()
    same = [number for number, found in enumerate(sets) if np.allclose(found, uvs, atol=1e-6)]
    which = f"UV set {same[0]} of {len(sets)} (from 0)" if same else "the UVs of the occlusion texture"
    return (Note(f"{surface.picture.name}: is drawn on {which}"),)


def _check_that_it_belongs(surface: TexturedSurface, mesh: Mesh) -> None:
    """Raise InputError where a texture that was given is certainly not that of the mesh.

    Both sides of a UV seam are one place, so that they have like values in the right texture; in the textures of other
    meshes, and in one upside down, they differ as much as any two places.
    """
    picture = surface.picture
    found = _seam_ratio(surface, picture.values)
    if found is None or found <= _MAX_SEAM_RATIO:
        return
    turned = _seam_ratio(surface, picture.values[::-1])
    upside_down = turned is not None and turned < _MAX_SEAM_RATIO - 0.2
    advice = "it fits upside down: flip it" if upside_down else "pass the texture of this mesh"
    raise InputError(
        f"{picture.name}: does not belong to {mesh._scene.path}: on the two sides of UV seams, which are one place, it "
        f"differs as two random places do; {advice}"
    )


def _seam_ratio(surface: TexturedSurface, values: Float32Array) -> float | None:
    """Return the difference across seams over that of random places; None where there is too little to tell."""
    found = seam_difference(surface.scene, values, surface.picture.uvs, surface.mapped)
    if found is None or found.seams < _MIN_SEAMS or found.random < _MIN_CONTRAST:
        return None
    return found.across / found.random


def _without_texture(mesh: Mesh) -> MeshToDraw:
    scene = mesh._scene
    bare = TexturedMesh(scene, _normals(scene, ValueOptions()), None, None, np.zeros(len(scene.faces), bool))
    advice = "bake it first"
    if scene.format:
        advice = baked_copy(scene.path) or f"to bake it: aoprecalc bake {shlex.quote(str(scene.path))}"
    note = Note(f"{scene.path}: has no ambient occlusion, it is drawn as clay; {advice}")
    messages = (*scene.notes, *scene.warnings, note)
    return MeshToDraw(bare, mesh.name, None, None, up_axis(scene, ValueOptions()), _files(scene), messages)


def _baked_to_draw(baked: Baked) -> MeshToDraw:
    scene = baked.scene
    uvs = output_uvs(scene, baked.atlas)
    mesh = TexturedMesh(scene, baked.normals.astype(np.float64), uvs, baked.texture.values, scene.receives)
    up, all_parts = up_axis(scene, baked.options), baked.options.all_parts
    return MeshToDraw(mesh, scene.path.stem, "its bake", None, up, _files(scene), all_parts=all_parts)


def _normals(scene: Scene, options: ValueOptions) -> Float64Array:
    return shading_normals(scene, options.normals, options.crease_angle).astype(np.float64)
