"""The files of a bake: what they are called, whether they can be written, and writing them."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path

from aoprecalc.api.bake_textures import BakedTextures, TextureBake
from aoprecalc.api.certified_bake import check_lossless, shows_as_measured
from aoprecalc.api.directional_files import WrittenPictures, write_pictures
from aoprecalc.api.reports import AoReference, BakeOutputs
from aoprecalc.api.textured_surface import verify_words
from aoprecalc.errors import ArgumentError, UsageError, counted, one_or_many
from aoprecalc.io import (
    IMAGE_EXTENSIONS,
    OUTPUT_MESH_EXTENSIONS,
    Outputs,
    check_mesh_extension,
    choose_bit_depth,
    output_mesh_extension,
    read_image,
    write_baked_mesh,
    write_image,
)
from aoprecalc.io.baked_options import bake_text
from aoprecalc.io.formats.base import MeshWithAo, VertexOcclusion
from aoprecalc.io.formats.textures import Directions, MeshTexture
from aoprecalc.io.images import BIT_DEPTHS, EXTENSIONS_WITHOUT_TEXT, read_text
from aoprecalc.io.meshes import format_of
from aoprecalc.io.outputs import claim_output, output_path, texture_stem
from aoprecalc.options import BakeOptions, BitDepth, ValueOptions, VerifyOptions
from aoprecalc.progress import Note
from aoprecalc.types import Baked, Float32Array, Scene

Output = str | PathLike[str]

HARMONICS_EXTENSIONS = (".exr", ".tif", ".tiff", ".png")  # for four linear channels
_EMBEDDED = ".png"  # the format of a texture inside a GLB


@dataclass(frozen=True, eq=False)
class BakeFiles:
    """Paths of the files of a bake; others that go with the mesh are beside it.

    Attributes
    ----------
    texture : Path or None
        None where the texture is inside the mesh, a GLB; of several the first.
    mesh : Path
    textures : tuple of Path
        All textures; none where they are inside the mesh.
    bent_normals, sh : tuple of Path
        Pictures of the bent normals and of spherical harmonics, one for each texture; empty where they are not asked
        for.
    """

    texture: Path | None
    mesh: Path
    textures: tuple[Path, ...]
    bent_normals: tuple[Path, ...] = ()
    sh: tuple[Path, ...] = ()


@dataclass(frozen=True)
class WrittenBake:
    """The files of a bake as they were written.

    files       their final paths
    textures    the textures now: temporary files
    inverted    they hold 1 - AO
    references  where the mesh refers to the textures
    messages    warnings and notes for the user
    """

    files: BakeFiles
    textures: tuple[Path, ...]
    inverted: bool
    references: tuple[AoReference, ...]
    messages: tuple[str, ...]

    def values(self) -> list[Float32Array]:
        """Return the AO that each texture holds, (height, width) float32, as it is stored."""
        stored = map(read_image, self.textures)
        return [1 - values if self.inverted else values for values in stored]

    def outputs(self, outputs: Outputs) -> BakeOutputs:
        """Return what the report says about them; `others` go with the mesh (.mtl, .bin, images)."""
        files, texture, mesh = self.files, self.files.texture, self.files.mesh
        named = {path.resolve() for path in (*files.textures, *files.bent_normals, *files.sh, mesh)}
        others = sorted(str(mesh.parent / path.name) for path in outputs.files if path not in named)
        return BakeOutputs(
            texture=None if texture is None else str(texture),
            inverted=self.inverted,
            mesh=str(mesh),
            others=tuple(others),
            references=self.references,
            textures=tuple(map(str, files.textures)),
            bent_normals=tuple(map(str, files.bent_normals)),
            sh=tuple(map(str, files.sh)),
        )


@dataclass(frozen=True)
class _File:
    """One file of a bake: its path, and what the user gave for it."""

    path: Path
    given: Output | None = None


@dataclass(frozen=True)
class BakePlan:
    """Where the files of a bake go.

    stem        of the texture, and of the mesh beside it
    texture     None: inside the GLB
    mesh        None: its name and extension are not given
    mesh_given  the argument `mesh_output`
    report      None: not asked for
    bent, sh    pictures of the bent normals and of spherical harmonics; None: not asked for
    options     of the bake
    """

    stem: str
    texture: _File | None
    mesh: _File | None
    mesh_given: Output | None
    report: _File | None
    bent: _File | None
    sh: _File | None
    options: BakeOptions

    def claim(self, outputs: Outputs) -> None:
        """Make sure that the files whose names are known can be written; see Outputs.claim."""
        files = [file for file in (self.texture, self.mesh, self.report, self.bent, self.sh) if file is not None]
        for file in sorted(files, key=lambda file: file.given is None):  # an error names what the user gave
            claim_output(outputs, file.given, file.path)

    def claim_mesh(self, outputs: Outputs, scene: Scene) -> None:
        """Do so for the mesh, where its extension is the scene's; raises UsageError where it cannot be made of that."""
        if self.mesh is not None:
            format_of(self.mesh.path).check_source(self.mesh.path, scene)
        if self.mesh is not None or self.texture is None:
            return
        try:
            claim_output(outputs, self.mesh_given, self._mesh_path(output_mesh_extension(scene)[0]))
        except ArgumentError:
            raise
        except UsageError as error:
            raise UsageError(f"{error} (it is the mesh beside {self.texture.path}; see --mesh-output)") from error

    def write(self, outputs: Outputs, bake: BakedTextures, scratch: Path) -> WrittenBake:
        """Write the textures and the mesh.

        scratch   a folder for textures that go into a GLB only
        """
        baked = bake.whole
        suffix, reason = output_mesh_extension(baked.scene, [one.baked.atlas for one in bake.textures])
        mesh = self._mesh_path(suffix) if self.mesh is None else self.mesh.path
        first = scratch / f"{self.stem}{_EMBEDDED}" if self.texture is None else self.texture.path
        pictures = [_of_texture(first, one.name) for one in bake.textures]
        written, shown = list[Path](), list[MeshTexture]()
        for path, one in zip(pictures, bake.textures, strict=True):
            written.append(path if self.texture is None else outputs.path(path))
            self._write_picture(written[-1], one.baked, self.options.bit_depth, inverted=self.options.invert)
            upright = self._write_upright(outputs, mesh, one, scratch) if self.options.invert else path
            certificate = one.baked.certificate if shows_as_measured(self.options, upright) else None
            shown.append(MeshTexture(one.name, upright, one.baked.atlas, one.faces, certificate=certificate))
        bent = self._write_directional(outputs, bake, mesh, "bent normals", scratch)
        harmonics = self._write_directional(outputs, bake, mesh, "spherical harmonics", scratch)
        directional = zip(*(made.shown for made in (bent, harmonics) if made.shown), strict=True)
        for number, beside in enumerate(directional):
            shown[number] = replace(shown[number], directional=beside)
        tangents = bake.tangents() if self.in_tangent_space and format_of(mesh).holds_tangents else None
        values, as_color = baked.vertex_ao, self.options.vertex_ao == "color"
        vertices = None if values is None else VertexOcclusion(values, as_color)
        made = write_baked_mesh(
            outputs,
            mesh,
            MeshWithAo(
                baked.scene,
                tuple(shown),
                baked.normals,
                pack=self.options.pack,
                options=baked.options,
                strength=self.options.strength,
                vertices=vertices,
                tangents=tangents,
            ),
        )
        messages = (*made.messages, *bent.notes, *harmonics.notes, *_notes_on_options(pictures[0], mesh, baked.options))
        messages += _warnings_on_strength(mesh, self.options.strength)
        if self.options.invert:
            messages += _messages_on_inversion(pictures, mesh, shown, readable=bool(read_text(written[0])))
        if reason and self.mesh is None and self.mesh_given is None:
            messages += (Note(reason),)
        references = tuple(
            AoReference(use.slot, use.materials, use.uvs, use.packed, use.strength) for use in made.references
        )
        beside = () if self.texture is None else tuple(pictures)
        files = BakeFiles(next(iter(beside), None), mesh, beside, bent.paths, harmonics.paths)
        return WrittenBake(files, tuple(written), self.options.invert, references, messages)

    def _write_picture(self, path: Path, baked: Baked, bit_depth: BitDepth, *, inverted: bool) -> None:
        values = 1 - baked.texture.values if inverted else baked.texture.values
        text = bake_text(baked.options, len(baked.scene.faces), baked.certificate, inverted=inverted)
        write_image(path, values, bit_depth, text)

    @property
    def in_tangent_space(self) -> bool:
        """Whether a picture needs the tangents of the mesh to be read."""
        return (self.bent is not None or self.sh is not None) and self.options.bent_space == "tangent"

    def _write_directional(
        self,
        outputs: Outputs,
        bake: BakedTextures,
        mesh: Path,
        holds: Directions,
        scratch: Path,
    ) -> WrittenPictures:
        """Write the bent normals of each texture, or the spherical harmonics, where they are asked for."""
        file = self.bent if holds == "bent normals" else self.sh
        if file is None:
            return WrittenPictures()
        paths = [_of_texture(file.path, one.name) for one in bake.textures]
        folder = (scratch / holds) if _embeds(mesh) else None
        return write_pictures(outputs, holds, paths, bake.textures, self.options, mesh, folder)

    def _write_upright(self, outputs: Outputs, mesh: Path, texture: TextureBake, scratch: Path) -> Path:
        """Write the picture of the AO that the mesh refers to where a texture is inverted; return its path."""
        depth = self.options.bit_depth if self.options.bit_depth in BIT_DEPTHS[_EMBEDDED] else "auto"
        if _embeds(mesh):
            path = written = _of_texture(scratch / f"{self.stem}{_EMBEDDED}", texture.name)
        else:
            beside = _of_texture(mesh.with_name(f"{self.stem}_open{_EMBEDDED}"), texture.name)
            path = next(outputs.candidates(beside))
            written = outputs.path(path)
        self._write_picture(written, texture.baked, depth, inverted=False)
        return path

    def _mesh_path(self, suffix: str) -> Path:
        """Return the path of a mesh whose name is not given: that of the texture, with another extension."""
        assert self.texture is not None  # a mesh that was asked for has a name
        path = output_path(self.mesh_given, self.texture.path.parent / f"{self.stem}{suffix}", "mesh_output")
        check_mesh_extension(path, self.options.pack, self.options.vertex_ao)
        return path


def _of_texture(path: Path, name: str) -> Path:
    """Return the path of one of several textures: its name comes before the extension."""
    return path.with_name(f"{path.stem}.{name}{path.suffix}") if name else path


def _notes_on_options(texture: Path, mesh: Path, options: ValueOptions) -> tuple[Note, ...]:
    """Note that neither file says how the texture was baked, where `verify` has to know it."""
    words = verify_words(options, VerifyOptions())
    if not words or texture.suffix.lower() not in EXTENSIONS_WITHOUT_TEXT or format_of(mesh).holds_options:
        return ()
    advice = f"pass them to verify ({shlex.join(words)}), or write a .png"
    return (Note(f"{texture} cannot hold the options of the bake: {advice}"),)


def _warnings_on_strength(mesh: Path, strength: float) -> tuple[str, ...]:
    """Warn that the strength is not written, where the format of the mesh has none."""
    mesh_format = format_of(mesh)
    if strength == 1 or mesh_format.has_strength:
        return ()
    return (f"{mesh}: {mesh_format.name} has no strength of occlusion, {strength:g} is not written; write a .glb",)


def _messages_on_inversion(
    textures: Sequence[Path], mesh: Path, shown: Sequence[MeshTexture], *, readable: bool
) -> tuple[str, ...]:
    """Tell which pictures are inverted, and warn where they do not say so themselves."""
    count = len(textures)
    first, other = (_and_others(name, count) for name in (str(textures[0]), shown[0].path.name))
    inside = one_or_many(count, "has one of the AO inside", f"has {count} of the AO inside")
    place = inside if _embeds(mesh) else f"refers to {other}, of the AO"
    note = Note(f"{first} {one_or_many(count, 'holds', 'hold')} the occlusion, 1 - AO; {mesh} {place}")
    if readable:
        return (note,)
    say = one_or_many(count, "say that it is inverted", "say that they are inverted")
    return (
        note,
        f"{first} cannot {say}: other commands will take {one_or_many(count, 'it', 'them')} for AO; write a .png",
    )


def _and_others(name: str, count: int) -> str:
    """Return what stands for several files: the name of the first, and how many others there are."""
    return name if count == 1 else f"{name} and {counted(count - 1, 'other')}"


def plan_bake(
    stem: str,
    output: Output | tuple[Output, ...] | None,
    mesh_output: Output | None,
    report: Output | None,
    options: BakeOptions,
    bent_normals: Output | None = None,
    sh: Output | None = None,
) -> BakePlan:
    """Return where the files of a bake go.

    stem     of the mesh that is baked
    output   an image, a mesh or a folder, or an image and a mesh; None: <stem>_ao.png. The texture beside a mesh
             X.<ext> is X_ao.png, or X.png where X ends in _ao

    Raises UsageError for an unknown extension, for a combination that makes no sense, and for a bit depth or a packing
    that a format lacks.
    """
    given = output or (None,) if isinstance(output, tuple) else (output,)
    files = [_File(output_path(wanted, f"{stem}_ao.png"), wanted) for wanted in given]
    meshes = [file for file in files if file.path.suffix.lower() in OUTPUT_MESH_EXTENSIONS]
    images = [file for file in files if file not in meshes]
    for file in images:
        _check_known(file.path)
    for kind, found in (("images", images), ("meshes", meshes)):
        if len(found) > 1:
            names = " and ".join(str(file.path) for file in found)
            raise ArgumentError("output", f"names the {kind} {names}; expected one image, one mesh or both; omit one")
    if meshes and mesh_output is not None:
        raise ArgumentError(
            "mesh_output",
            f"is {fspath(mesh_output)}, but {{output}} names the mesh {meshes[0].path}; omit one of them",
            "output",
        )
    mesh = meshes[0] if meshes else None
    if options.invert and mesh is not None and not images:
        raise ArgumentError(
            "invert",
            f"is for a picture, but {{output}} names a mesh alone, {mesh.path}, whose format means 1 is open; name a "
            f"picture as well, such as {mesh.path.stem}_occlusion.png",
            "output",
        )
    if mesh is not None:
        check_mesh_extension(mesh.path, options.pack, options.vertex_ao, options.textures)
    elif mesh_output is not None:
        mesh = _given_mesh(mesh_output, options)
    texture = images[0] if images else None
    if meshes and texture is None and not _embeds(meshes[0].path):
        mesh_path = meshes[0].path
        texture = _File(mesh_path.with_name(f"{texture_stem(mesh_path.stem)}.png"))
    if texture is not None:
        choose_bit_depth(texture.path, options.bit_depth)
        check_lossless(texture.path, options)
    elif mesh is not None and options.bit_depth not in ("auto", *BIT_DEPTHS[_EMBEDDED]):
        raise ArgumentError(
            "bit_depth",
            f"is {options.bit_depth}, but the texture inside {mesh.path} is a PNG, which has 8 or 16; omit it, or ask "
            "for an image as well with {output}",
            "output",
        )
    named = texture or mesh
    assert named is not None  # without any output there is a texture
    report_file = None if report is None else _File(output_path(report, f"{stem}_report.json", "report"), report)
    wanted = {"bent_normals": (bent_normals, "bent.png"), "sh": (sh, "sh.exr")}
    bent, harmonics = (_given_picture(given, f"{stem}_{ending}", name) for name, (given, ending) in wanted.items())
    return BakePlan(named.path.stem, texture, mesh, mesh_output, report_file, bent, harmonics, options)


def _given_picture(wanted: Output | None, default: str, argument: str) -> _File | None:
    """Return the picture of directions that an argument names; raises UsageError for one that cannot hold them."""
    if wanted is None:
        return None
    path = output_path(wanted, default, argument)
    _check_known(path)
    if argument == "sh" and path.suffix.lower() not in HARMONICS_EXTENSIONS:
        raise ArgumentError(
            argument, f"is {path}, which holds no four linear channels; use one of {', '.join(HARMONICS_EXTENSIONS)}"
        )
    return _File(path, wanted)


def _given_mesh(wanted: Output, options: BakeOptions) -> _File | None:
    """Return the mesh that `mesh_output` names; None for a folder, where it is named after the texture."""
    path = output_path(wanted, "mesh", "mesh_output")
    if path.name == "mesh" and path != Path(wanted):
        return None
    check_mesh_extension(path, options.pack, options.vertex_ao, options.textures)
    return _File(path, wanted)


def _check_known(path: Path) -> None:
    """Raise UsageError unless the extension is that of an image; those of meshes have been looked for."""
    suffix = path.suffix.lower()
    if suffix not in IMAGE_EXTENSIONS:
        found = f"the extension {suffix}" if suffix else "a name without extension"
        images, meshes = ", ".join(IMAGE_EXTENSIONS), ", ".join(OUTPUT_MESH_EXTENSIONS)
        raise UsageError(
            f"{path}: {found} is neither that of an image ({images}) nor that of a mesh with UVs ({meshes}); "
            "choose one of these, or a folder"
        )


def _embeds(mesh: Path) -> bool:
    return mesh.suffix.lower() in (".glb", ".vrm", ".usdz")
