"""An occlusion texture on its mesh, for `verify` and `compare`: the faces that it covers, and how it was baked."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aoprecalc.errors import AoprecalcError, InputError, counted, one_or_many, option_name
from aoprecalc.io import OcclusionTexture
from aoprecalc.io.meshes import Misfit
from aoprecalc.mesh.normals import face_normals
from aoprecalc.mesh.roles import assign_roles, names_a_part
from aoprecalc.options import ValueOptions, VerifyOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.raster.cpu_rasterizer import CPURasterizer
from aoprecalc.raster.layout import atlas_from_uvs, build_layout
from aoprecalc.types import Atlas, BoolArray, Scene


@dataclass(frozen=True, eq=False)
class TexturedSurface:
    """A texture on its mesh.

    scene      with the roles of its parts
    picture    the texture
    atlas      its UVs, and the faces that it covers: some, all of them with area
    options    what its values should be: the options that were given, else those of the bake, else the defaults
    taken      the words of a command line for what was taken from the bake and is no default
    warnings   for the user
    """

    scene: Scene
    picture: OcclusionTexture
    atlas: Atlas
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
        atlas, left_out = _atlas(scene, picture)
        taken = () if baked is None else verify_words(options, given)
        return cls(scene, picture, atlas, options, taken, (*picture.warnings, *missing, *left_out))

    def coverage(self) -> BoolArray:
        """Return the texels of the texture that the surface covers at least in part, (height, width) bool."""
        height, width = self.picture.values.shape
        covered: BoolArray = np.zeros(height * width, bool)
        covered[CPURasterizer(build_layout(self.scene, self.atlas, width, height)).coverage().index] = True
        return covered.reshape(height, width)

    def overlap(self) -> float:
        """Return the share of the covered texels that lie inside two triangles; not those that instances share."""
        owners = assign_roles(self.scene, self.options, share=True).parts
        mapped = self.atlas.mapped & self.scene.per_face(part.uv_owner is None for part in owners)
        height, width = self.picture.values.shape
        return CPURasterizer(build_layout(self.scene, replace(self.atlas, mapped=mapped), width, height)).overlap()


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


def _atlas(scene: Scene, picture: OcclusionTexture) -> tuple[Atlas, tuple[str, ...]]:
    """Return the UVs with the faces that they map, and warnings about the others.

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
    return atlas_from_uvs(scene, picture.uvs, mapped), tuple(warnings)
