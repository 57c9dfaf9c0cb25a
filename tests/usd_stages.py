"""USD stages made by code, and bakes of them made by hand."""

import numpy as np
from pxr import Gf, Sdf, UsdGeom, UsdShade

from aoprecalc.io import Outputs, load_scene, write_image
from aoprecalc.io.formats.base import source_polygons
from aoprecalc.mesh.roles import assign_roles
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.types import Atlas
from written_meshes import write_with_one_texture

CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
PLAIN = "none"


def add_mesh(stage, path, points=CORNERS, faces=SIDES, scheme=PLAIN):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.GetPointsAttr().Set([Gf.Vec3f(*map(float, point)) for point in points])
    mesh.GetFaceVertexCountsAttr().Set([len(face) for face in faces])
    mesh.GetFaceVertexIndicesAttr().Set([vertex for face in faces for vertex in face])
    if scheme:
        mesh.GetSubdivisionSchemeAttr().Set(scheme)
    return mesh


def add_uvs(mesh, name, values, interpolation="faceVarying", indices=None):
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, kind, interpolation)
    primvar.Set([Gf.Vec2f(*map(float, value)) for value in values])
    if indices is not None:
        primvar.SetIndices(indices)


def add_material(stage, path, picture=None, channel="a", slot="opacity", **inputs):
    """A UsdPreviewSurface; `picture` is connected to the input `slot`."""
    material, shader = UsdShade.Material.Define(stage, path), UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        kind = Sdf.ValueTypeNames.Color3f if isinstance(value, tuple) else Sdf.ValueTypeNames.Float
        shader.CreateInput(name, kind).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    if picture is not None:
        texture, reader = (UsdShade.Shader.Define(stage, f"{path}/{name}") for name in ("texture", "reader"))
        texture.CreateIdAttr("UsdUVTexture")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(picture)
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(reader.ConnectableAPI(), "result")
        shader.CreateInput(slot, Sdf.ValueTypeNames.Float).ConnectToSource(texture.ConnectableAPI(), channel)
    return material


def bind(prim, material):
    UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(material)


QUAD = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


def polygon_atlas(scene, keep=False):
    """Each polygon a regular one of its own, in a grid; or the first UVs of the file."""
    owned = scene.receives & scene.per_face(part.uv_owner is None for part in scene.parts)
    if keep:
        return Atlas("keep", scene.uvs, owned, 1, uv_set=0)
    polygons = source_polygons(scene)
    corner = np.arange(polygons.counts.sum()) - np.repeat(np.cumsum(polygons.counts) - polygons.counts, polygons.counts)
    angle = 2 * np.pi * corner / np.repeat(polygons.counts, polygons.counts)
    side = int(np.ceil(np.sqrt(len(polygons.counts))))
    number = np.repeat(np.arange(len(polygons.counts)), polygons.counts)
    cell = np.stack([number % side, number // side], axis=1) + 0.5
    uvs = (cell + 0.4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)) / side
    return Atlas("xatlas", np.where(owned[:, None, None], uvs[polygons.triangles], 0.0), owned, len(polygons.counts))


def write_baked(source, target, *, keep=False, normals=None, texture=None, **options):
    """Write a stage with such an atlas; returns (scene, atlas, what was written)."""
    options = BakeOptions(**options)
    scene = assign_roles(load_scene(source), options, share=options.instances == "share")
    atlas = polygon_atlas(scene, keep)
    if normals is None:
        normals = np.zeros((len(scene.faces), 3, 3), np.float32) + (0, 0, 1) if scene.normals is None else scene.normals
    texture = texture or target.with_name(f"{target.stem}.png")
    with Outputs() as outputs:
        outputs.folder(target.parent)
        values = np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)
        write_image(outputs.path(texture), values)
        written = write_with_one_texture(
            outputs, target, scene, atlas, normals.astype(np.float32), texture, options=ValueOptions()
        )
    return scene, atlas, written
