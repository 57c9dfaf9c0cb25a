"""What becomes of files like those of game packs, scanners, CAD and maps: a table of kinds, each with its right value.

    python benchmarks/real_assets.py [--before SRC] [--readers] [--blender PYTHON] [--folder DIR] [--only WORD]

Every row makes its input here, runs the command that it shows, and reads what was written with other programs' code.
--before   the `src` of another checkout, which runs the same rows
--readers  glTF-Validator, three.js, USD's validators and, with --blender (an interpreter that has `bpy`), Blender's
           importers read every mesh that was written, and the input; complaints that the input does not raise are told
The table goes into benchmarks/results/real_assets.json.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from fbx_text import FbxText
from gltf_kit.gltf_maker import GltfMaker
from gltf_kit.gltf_values import GltfValues

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).resolve().with_name("results") / "real_assets.json"
FAST = "--size 128 -n 64"
MESHES = (".obj", ".ply", ".glb", ".gltf", ".vrm", ".usda", ".usdc", ".usdz")  # that are written

# The input of most rows: a stool, a seat on a block.
STOOL = [((-1, 1.0, -1), (1, 1.3, 1)), ((-0.4, 0, -0.4), (0.4, 1.0, 0.4))]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CHECKER = np.kron(np.indices((8, 8)).sum(0) % 2, np.ones((8, 8)))[..., None] * [200, 60, 20] + [30, 60, 120]


@dataclass(frozen=True)
class Answer:
    """What a command left: its exit code, its messages, and the mesh that it wrote, if any."""

    code: int
    messages: str
    mesh: Path | None

    @property
    def scene(self) -> trimesh.Scene:
        """The mesh, as trimesh reads it."""
        return trimesh.load_scene(self.mesh, process=False)

    @property
    def gltf(self) -> GltfValues:
        """The mesh, as a glTF document."""
        return GltfValues(self.mesh)


@dataclass(frozen=True)
class Row:
    """A kind of input: how to make it, what to run, and what to read from the answer.

    right   the right value, as `read` tells it
    """

    kind: str
    make: Callable[[Path], Path]
    read: Callable[[Answer], str]
    right: str
    options: str = FAST


# Making inputs.


def boxes(places: list[tuple]) -> tuple[np.ndarray, list[tuple]]:
    """Return positions and quads of boxes, each from its least to its greatest corner."""
    positions, quads = [], []
    for low, high in places:
        quads += [tuple(len(positions) + corner for corner in quad) for quad in QUADS]
        positions += [[(high if corner >> axis & 1 else low)[2 - axis] for axis in (2, 1, 0)] for corner in range(8)]
    return np.array(positions, float), quads


def obj(path: Path, *, corner: str = "{v}/{t}", head: str = "", offset=(0, 0, 0), encoding: str = "utf-8") -> Path:
    """Write the stool, every quad over the whole picture; `corner` is how a corner of a face is written."""
    positions, quads = boxes(STOOL)
    lines = [head, *(f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in positions + offset)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", *(["usemtl wood"] if "mtllib" in head else [])]
    for quad in quads:
        lines.append("f " + " ".join(corner.format(v=at + 1, t=number + 1) for number, at in enumerate(quad)))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes("\n".join([*lines, ""]).encode(encoding))
    return path


def painted(folder: Path, head: str, files: dict[str, str | np.ndarray]) -> Path:
    """Write the stool with materials: texts, and pictures as arrays."""
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            (folder / name).write_text(content, encoding="utf-8")
        else:
            Image.fromarray(content.astype(np.uint8)).save(folder / name)
    return obj(folder / "stool.obj", head=head)


def wood(picture: str = "wood.png", more: str = "") -> str:
    """Return a material with a picture."""
    return f"newmtl wood\nKd 1 1 1\nmap_Kd {picture}\n{more}"


def off(folder: Path, head: str) -> Path:
    """Write the stool as OFF, with `{}` in the head for its counts."""
    positions, quads = boxes(STOOL)
    lines = [head.format(f"{len(positions)} {len(quads)} 0")]
    lines += [f"{x:g} {y:g} {z:g}" for x, y, z in positions] + [f"4 {a} {b} {c} {d}" for a, b, c, d in quads]
    (folder / "stool.off").write_text("\n".join([*lines, ""]))
    return folder / "stool.off"


def gear(folder: Path, corners: int) -> Path:
    """Write a gear: two concave polygons of many corners, and the quads between them."""
    angle = np.arange(corners) * 2 * np.pi / corners
    ring = np.where(np.arange(corners) // 15 % 2, 1.0, 0.55)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    lines = [f"v {x:.9g} {height} {-y:.9g}" for height in (0, 0.5) for x, y in ring]
    low, high = range(1, corners + 1), range(corners + 1, 2 * corners + 1)
    quads = [(low[i], low[i - corners + 1], high[i - corners + 1], high[i]) for i in range(corners)]
    lines += ["f " + " ".join(map(str, face)) for face in [tuple(reversed(low)), tuple(high), *quads]]
    (folder / "gear.obj").write_text("\n".join([*lines, ""]))
    return folder / "gear.obj"


def noisy_stl(folder: Path) -> Path:
    """Write a ball whose facets are rounded each by itself."""
    corners = trimesh.creation.icosphere(3).triangles * 50
    corners = corners + np.random.default_rng(1).uniform(-1e-4, 1e-4, corners.shape)
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(corners), process=False).export(folder / "ball.stl")
    return folder / "ball.stl"


def ply_with_picture(folder: Path) -> Path:
    """Write the stool with UVs that hold a bake, and a picture of its own."""
    positions, quads = boxes(STOOL)
    rows = []
    for number, quad in enumerate(quads):
        low = np.array([number % 4, number // 4]) / 4 + 0.02
        corners = low + 0.2 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        rows += np.column_stack([positions[list(quad)], corners]).tolist()
    head = ["ply", "format ascii 1.0", "comment TextureFile colour.png", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in "xyzst"]
    head += [f"element face {len(quads)}", "property list uchar int vertex_indices", "end_header"]
    faces = [f"4 {4 * i} {4 * i + 1} {4 * i + 2} {4 * i + 3}" for i in range(len(quads))]
    vertices = [" ".join(f"{number:.6g}" for number in row) for row in rows]
    (folder / "stool.ply").write_text("\n".join([*head, *vertices, *faces, ""]))
    Image.fromarray(CHECKER.astype(np.uint8)).save(folder / "colour.png")
    return folder / "stool.ply"


def stool_primitive(maker: GltfMaker, *, sets: int = 0, **members) -> dict:
    """Return a primitive of the stool, with as many UV sets, all over the whole picture."""
    positions, quads = boxes(STOOL)
    corners = [quad[i] for quad in quads for i in (0, 1, 2, 3)]
    triangles = np.arange(len(corners)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]]
    attributes = {"POSITION": maker.vertices(positions[corners].astype("<f4"), bounds=True)}
    square = np.tile(np.array([(0, 1), (1, 1), (1, 0), (0, 0)], "<f4"), (len(quads), 1))
    attributes |= {f"TEXCOORD_{number}": maker.vertices(square) for number in range(sets)}
    own = members.pop("attributes", {})
    return {"attributes": attributes | own, "indices": maker.indices(triangles.astype("<u2"))} | members


def gltf(folder: Path, build: Callable[[GltfMaker], None], name: str = "stool.glb", **arguments) -> Path:
    """Write a glTF document that `build` fills."""
    maker = GltfMaker(folder)
    build(maker)
    return maker.save(name, **arguments)


def plain_stool(maker: GltfMaker) -> None:
    """Add the stool alone."""
    maker.node(mesh=maker.mesh(stool_primitive(maker)), name="stool")


def feature_ids(maker: GltfMaker) -> None:
    """Add the stool with EXT_mesh_features whose ids are those of the vertices."""
    ids = {"EXT_mesh_features": {"featureIds": [{"featureCount": 48}]}}
    maker.json["extensionsUsed"] = ["EXT_mesh_features"]
    maker.node(mesh=maker.mesh(stool_primitive(maker, extensions=ids)), name="stool")


def shared_occlusion(maker: GltfMaker) -> None:
    """Add two stools whose materials share an occlusion texture, one with a strength and a transform."""
    texture = maker.texture(np.full((4, 4, 3), 200))
    moved = {"KHR_texture_transform": {"scale": [2, 2]}}
    occlusions = [{"index": texture}, {"index": texture, "strength": 0.5, "extensions": moved}]
    maker.json["extensionsUsed"] = ["KHR_texture_transform"]
    for place, occlusion in enumerate(occlusions):
        material = maker.add("materials", {"occlusionTexture": occlusion})
        mesh = maker.mesh(stool_primitive(maker, sets=1, material=material))
        maker.node(mesh=mesh, name=f"stool {place}", translation=[3.0 * place, 0, 0])


def variants(maker: GltfMaker) -> None:
    """Add the stool with two variants of its material."""
    materials = [maker.add("materials", {"name": name}) for name in ("day", "night")]
    mappings = [{"material": material, "variants": [material]} for material in materials]
    maker.json |= {"extensionsUsed": ["KHR_materials_variants"]}
    maker.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}}
    members = {"material": materials[0], "extensions": {"KHR_materials_variants": {"mappings": mappings}}}
    maker.node(mesh=maker.mesh(stool_primitive(maker, **members)), name="stool")


def three_uv_sets(maker: GltfMaker) -> None:
    """Add the stool with three UV sets, of which a material uses the first."""
    color = {"pbrMetallicRoughness": {"baseColorTexture": {"index": maker.texture(CHECKER)}}}
    maker.node(mesh=maker.mesh(stool_primitive(maker, sets=3, material=maker.add("materials", color))), name="stool")


def levels(maker: GltfMaker) -> None:
    """Add two levels of detail one inside the other, and a collision hull around both."""
    for name, mesh in (
        ("ball_LOD0", trimesh.creation.icosphere(3)),
        ("ball_LOD1", trimesh.creation.icosphere(1, radius=0.9)),
        ("UCX_ball", trimesh.creation.box((2, 2, 2))),
    ):
        attributes = {"POSITION": maker.vertices(mesh.vertices.astype("<f4"), bounds=True)}
        primitive = {"attributes": attributes, "indices": maker.indices(mesh.faces.astype("<u2"))}
        maker.node(mesh=maker.mesh(primitive), name=name)


def zipped(folder: Path) -> Path:
    """Write a ZIP that holds a glTF with its buffer."""
    inside = folder / "inside"
    inside.mkdir()
    gltf(inside, plain_stool, "stool.gltf", binary="stool.bin")
    with zipfile.ZipFile(folder / "stool.zip", "w") as archive:
        for name in ("stool.gltf", "stool.bin"):
            archive.write(inside / name, f"model/{name}")
    return folder / "stool.zip"


def vrm(folder: Path) -> Path:
    """Write a GLB under the name of an avatar."""
    return gltf(folder, plain_stool).rename(folder / "stool.vrm")


def collada(folder: Path) -> Path:
    """Write the stool as COLLADA."""
    positions, quads = boxes(STOOL)
    triangles = np.array([(quad[0], quad[i], quad[i + 1]) for quad in quads for i in (1, 2)])
    trimesh.Trimesh(positions, triangles, process=False).export(folder / "stool.dae")
    return folder / "stool.dae"


def collada_with_mask(folder: Path) -> Path:
    """Write the stool as COLLADA whose picture has holes in its alpha, as `transparent` says."""
    mesh = trimesh.load(obj(folder / "stool.obj"), process=False)
    Image.fromarray(np.dstack([CHECKER, 255 * (CHECKER[..., 0] > 100)]).astype(np.uint8)).save(folder / "leaf.png")
    text = mesh.export(file_type="dae").decode()
    picture = """<newparam sid="f"><surface type="2D"><init_from>leaf</init_from></surface></newparam>
        <newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>"""
    shading = """<phong><diffuse><texture texture="s" texcoord="UVSET0"/></diffuse>
        <transparent opaque="A_ONE"><texture texture="s" texcoord="UVSET0"/></transparent></phong>"""
    images = "<library_images><image id='leaf'><init_from>leaf.png</init_from></image></library_images>"
    text = re.sub(r"<library_images.*?(/>|</library_images>)", "", text, count=1, flags=re.DOTALL)
    text = text.replace("<library_effects>", f"{images}<library_effects>", 1)
    text = re.sub(
        r"(<profile_COMMON>)(.*?<technique [^>]*>).*?(</technique>)",
        rf"\1{picture}\2{shading}\3",
        text,
        flags=re.DOTALL,
    )
    (folder / "stool.dae").write_text(text)
    return folder / "stool.dae"


def fbx(folder: Path) -> Path:
    """Write the stool as FBX of text, with an embedded picture whose alpha is its opacity."""
    positions, quads = boxes(STOOL)
    picture = BytesIO()
    leaf = np.dstack([CHECKER, 255 * (CHECKER[..., 0] > 100)]).astype(np.uint8)
    Image.fromarray(leaf).save(picture, "PNG")
    scene = FbxText(unit=100)
    material = scene.material("leaf", DiffuseColor=(1, 1, 1))
    for slot in ("DiffuseColor", "TransparencyFactor"):
        scene.texture("leaf.png", material, slot, data=picture.getvalue())
    uvs = [((at % 4) / 4, at // 4 / len(quads)) for at in range(4 * len(quads))]
    mesh = scene.mesh(positions.tolist(), [list(map(int, quad)) for quad in quads], uv_sets=[("map1", uvs)])
    scene.node("stool", mesh, materials=[material])
    (folder / "stool.fbx").write_text(str(scene))
    return folder / "stool.fbx"


def usd(folder: Path, more: str = "", suffix: str = ".usda") -> Path:
    """Write the stool as a USD stage; `more` is added to its text."""
    from pxr import Sdf, UsdUtils

    positions, quads = boxes(STOOL)
    points = ", ".join(f"({x:g}, {y:g}, {z:g})" for x, y, z in positions)
    (folder / "stool.usda").write_text(
        '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n\ndef Mesh "stool"\n{\n'
        f"    int[] faceVertexCounts = {[4] * len(quads)}\n"
        f"    int[] faceVertexIndices = {[at for quad in quads for at in quad]}\n"
        f'    point3f[] points = [{points}]\n    uniform token subdivisionScheme = "none"\n}}\n{more}'
    )
    if suffix == ".usdz":
        UsdUtils.CreateNewUsdzPackage(str(folder / "stool.usda"), str(folder / "stool.usdz"))
    elif suffix != ".usda":
        Sdf.Layer.FindOrOpen(str(folder / "stool.usda")).Export(str(folder / f"stool{suffix}"))
    return folder / f"stool{suffix}"


SET = """
def PointInstancer "set"
{
    int[] protoIndices = [0, 0]
    point3f[] positions = [(5, 0, 0), (10, 0, 0)]
    rel prototypes = </set/kind>

    def "kind" (
        references = </stool>
    )
    {
    }
}
"""


# Reading answers.


def triangles(answer: Answer) -> str:
    """Return how many triangles were written."""
    return f"{sum(len(mesh.faces) for mesh in answer.scene.geometry.values())} triangles"


def usd_occlusion(answer: Answer) -> str:
    """Return the primvar of the occlusion of each mesh that has the texture, and how many files are missing."""
    from pxr import Usd, UsdGeom, UsdShade, UsdUtils

    found, stage = [], Usd.Stage.Open(str(answer.mesh))
    for prim in (prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)):
        surface = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
        texture = UsdShade.Shader(surface.GetInput("occlusion").GetConnectedSource()[0].GetPrim())
        reader = UsdShade.Shader(texture.GetInput("st").GetConnectedSource()[0].GetPrim())
        uvs = UsdGeom.PrimvarsAPI(prim).GetPrimvar(reader.GetInput("varname").Get())
        corners = len(UsdGeom.Mesh(prim).GetFaceVertexIndicesAttr().Get())
        if len(uvs.ComputeFlattened()) == corners and texture.GetInput("file").Get().resolvedPath:
            found.append(str(uvs.GetPrimvarName()))
    missing = len(UsdUtils.ComputeAllDependencies(str(answer.mesh))[2])
    return f"{answer.mesh.suffix}, {' '.join(found)}, {missing} files missing"


def base_color(answer: Answer) -> str:
    """Return the size of the pictures of the materials, and their alpha modes, as the glTF document has them."""
    json_, found = answer.gltf.json, []
    for material in json_.get("materials", []):
        texture = material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
        size = "no picture"
        if texture is not None:
            image = json_["images"][json_["textures"][texture["index"]]["source"]]
            size = f"picture {image.get('mimeType', image.get('uri'))}"
        found.append(" ".join([size, material.get("alphaMode", "")]).strip())
    return ", ".join(found)


def world_error(offset) -> Callable[[Answer], str]:
    """Return a reader of how far the written stool is from where it was, in units."""

    def read(answer: Answer) -> str:
        points = np.concatenate([mesh.vertices for mesh in answer.scene.dump()]) - np.array(offset)
        distance = np.abs(points[:, None] - boxes(STOOL)[0]).max(axis=2)
        error = max(distance.min(axis=0).max(), distance.min(axis=1).max())
        return "less than 1e-4" if error < 1e-4 else f"{error:.1g}"

    return read


def gear_area(corners: int) -> Callable[[Answer], str]:
    """Return a reader of the area of the written gear's two ends over the exact area."""
    angle = 2 * np.pi / corners
    radius = np.where(np.arange(corners) // 15 % 2, 1.0, 0.55)
    exact = float((radius * np.roll(radius, -1)).sum() * np.sin(angle))  # of both ends

    def read(answer: Answer) -> str:
        mesh = answer.scene.to_mesh()
        flat = np.abs(mesh.face_normals[:, 1]) > 0.99
        return f"area {mesh.area_faces[flat].sum() / exact:.6f} of the exact one"

    return read


def welded(answer: Answer) -> str:
    """Return whether the written ball is smooth: the greatest angle between a vertex normal and the ball's."""
    (mesh,) = answer.scene.geometry.values()
    outward = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    angle = np.degrees(np.arccos(np.einsum("vx,vx->v", mesh.vertex_normals, outward).min()))
    return "smooth" if angle < 3 else f"{angle:.0f} degrees off"


def told(*words: str) -> Callable[[Answer], str]:
    """Return a reader of whether the messages have one of some words."""
    return lambda answer: "said" if any(word in answer.messages for word in words) else "not said"


def features(answer: Answer) -> str:
    """Return whether every corner has the feature id that it had: its vertex's number in the source."""
    values = answer.gltf
    primitive = values.json["meshes"][0]["primitives"][0]
    entry = primitive["extensions"]["EXT_mesh_features"]["featureIds"][0]
    if "attribute" not in entry:
        count = values.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
        return "kept" if count == 48 else f"wrong: ids of {count} vertices for 48"
    ids = values.array(primitive["attributes"][f"_FEATURE_ID_{entry['attribute']}"])[:, 0].astype(int)
    positions, quads = boxes(STOOL)
    source = positions[[at for quad in quads for at in quad]]
    same = np.allclose(source[ids], values.array(primitive["attributes"]["POSITION"]))
    return "kept" if same else "wrong"


def occlusions(answer: Answer) -> str:
    """Return how many materials have an occlusion texture that is the bake, at full strength and not moved."""
    found = [material.get("occlusionTexture") for material in answer.gltf.json["materials"]]
    right = [one for one in found if one and one.get("strength", 1) == 1 and "extensions" not in one]
    return f"{len(right)} of {len(found)} materials"


def open_share(answer: Answer) -> str:
    """Return the mean of the two levels' textures."""
    return f"mean AO {json.loads(answer.mesh.with_suffix('.json').read_text())['ao']['mean']:.2f}"


def ao_set(answer: Answer) -> str:
    """Return the UV set of the occlusion texture."""
    return f"TEXCOORD_{answer.gltf.json['materials'][0]['occlusionTexture'].get('texCoord', 0)}"


UTM = (500012.345, 4649776.125, 120.5)
ROWS = [
    Row("OBJ f 1/1/", lambda at: obj(at / "stool.obj", corner="{v}/{t}/"), triangles, "24 triangles"),
    Row("OBJ f 1//", lambda at: obj(at / "stool.obj", corner="{v}//"), triangles, "24 triangles"),
    Row("OBJ f 1/", lambda at: obj(at / "stool.obj", corner="{v}/"), triangles, "24 triangles"),
    Row("OFF, header and counts in one word", lambda at: off(at, "OFF{}"), triangles, "24 triangles"),
    Row("OFF without header", lambda at: off(at, "{}"), triangles, "24 triangles"),
    Row("OFF with comments", lambda at: off(at, "# a\nOFF # b\n\n# c\n{} # d"), triangles, "24 triangles"),
    Row(
        "OBJ, two files in one mtllib",
        lambda at: painted(
            at,
            "mtllib metal.mtl wood.mtl",
            {"metal.mtl": "newmtl metal\nKd 1 0 0\n", "wood.mtl": wood(), "wood.png": CHECKER},
        ),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, mtllib with a blank and quotes",
        lambda at: painted(at, 'mtllib "my wood.mtl"', {"my wood.mtl": wood("my wood.png"), "my wood.png": CHECKER}),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, MTL and picture in a subfolder",
        lambda at: painted(at, "mtllib mats/wood.mtl", {"mats/wood.mtl": wood(), "mats/wood.png": CHECKER}),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, backslashes",
        lambda at: painted(at, "mtllib mats\\wood.mtl", {"mats/wood.mtl": wood("..\\wood.png"), "wood.png": CHECKER}),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, other capitals",
        lambda at: painted(at, "mtllib Wood.MTL", {"wood.mtl": wood("WOOD.PNG"), "wood.png": CHECKER}),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, map options",
        lambda at: painted(
            at, "mtllib w.mtl", {"w.mtl": wood("-s 2 2 1 -o 1 0 0 -bm 1 wood.png"), "wood.png": CHECKER}
        ),
        base_color,
        "picture image/png",
    ),
    Row(
        "OBJ, d 0.5",
        lambda at: painted(at, "mtllib w.mtl", {"w.mtl": wood(more="d 0.5\n"), "wood.png": CHECKER}),
        base_color,
        "picture image/png BLEND",
    ),
    Row("OBJ in UTF-16", lambda at: obj(at / "stool.obj", encoding="utf-16"), triangles, "24 triangles"),
    *(
        Row(
            f"OBJ with a {kind.upper()} picture",
            lambda at, kind=kind: painted(at, "mtllib w.mtl", {"w.mtl": wood(f"w.{kind}"), f"w.{kind}": CHECKER}),
            base_color,
            "picture image/png",
        )
        for kind in ("tga", "bmp", "tif")
    ),
    Row("PLY with a TextureFile", ply_with_picture, told("colour.png"), "said"),
    *(
        Row(
            f"glTF of the name {name!r}",
            lambda at, name=name: gltf(at, plain_stool, f"{name}.gltf", binary="b.bin"),
            triangles,
            "24 triangles",
        )
        for name in ("stool 10%", "stool#2", "stühle")
    ),
    Row(
        "OBJ at UTM coordinates into GLB",
        lambda at: obj(at / "stool.obj", offset=UTM),
        world_error(UTM),
        "less than 1e-4",
        f"{FAST} --mesh-output OUT/stool_ao.glb",
    ),
    *(
        Row(f"OBJ, faces of {n} corners", lambda at, n=n: gear(at, n), gear_area(n), "area 1.000000 of the exact one")
        for n in (60, 1200)
    ),
    Row("STL, corners that differ in the last bits", noisy_stl, welded, "smooth"),
    Row("EXT_mesh_features, ids of vertices", lambda at: gltf(at, feature_ids), features, "kept"),
    Row(
        "occlusion texture shared, strength, transform",
        lambda at: gltf(at, shared_occlusion),
        occlusions,
        "2 of 2 materials",
    ),
    Row("KHR_materials_variants", lambda at: gltf(at, variants), occlusions, "2 of 2 materials"),
    Row("three UV sets, of which one is used", lambda at: gltf(at, three_uv_sets), ao_set, "TEXCOORD_1"),
    Row("glTF in a ZIP", zipped, triangles, "24 triangles"),
    Row("VRM", vrm, lambda answer: answer.mesh.suffix, ".vrm"),
    Row("COLLADA", collada, triangles, "24 triangles"),
    Row("COLLADA with a picture and a mask", collada_with_mask, base_color, "picture image/png MASK"),
    Row("FBX", fbx, triangles, "24 triangles"),
    Row("FBX with an embedded picture and a mask", fbx, base_color, "picture image/png MASK"),
    *(
        Row(
            f"USD ({kind})",
            lambda at, kind=kind: usd(at, suffix=kind),
            usd_occlusion,
            f"{kind}, st1, 0 files missing",
        )
        for kind in (".usda", ".usdc", ".usdz")
    ),
    Row("USD with a PointInstancer", lambda at: usd(at, SET), usd_occlusion, ".usda, st1 st1, 0 files missing"),
    Row(
        "levels of detail and a collision hull",
        lambda at: gltf(at, levels),
        open_share,
        "mean AO 1.00",
        f"{FAST} --report OUT/stool_ao.json",
    ),
]


# Running.


def run(row: Row, source: Path, folder: Path) -> tuple[Answer, Path]:
    """Make a row's input and run its command with the package in `source`."""
    out, made = folder / "out", folder / "in"
    for each in (out, made):
        each.mkdir(parents=True)
    mesh = row.make(made)
    options = [word.replace("OUT", str(out)) for word in row.options.split()]
    command = [sys.executable, "-m", "aoprecalc", "bake", str(mesh), "-o", f"{out}/", *options]
    environment = os.environ | {"PYTHONPATH": str(source)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)
    written = sorted(path for path in out.iterdir() if path.suffix in MESHES)
    return Answer(done.returncode, done.stderr, written[0] if written else None), mesh


def told_value(row: Row, answer: Answer) -> str:
    """Return what the row's reader says, or why it cannot say anything."""
    if answer.code:
        last = (answer.messages.strip().splitlines() or [""])[-1]
        return f"exit code {answer.code}: {re.sub(r'/[^:]*/', '', last)}"  # the same wherever it ran
    if answer.mesh is None:
        return "no mesh was written"
    try:
        return row.read(answer)
    except Exception as error:  # of a damaged output
        return f"unreadable: {type(error).__name__}: {error}"


def complaints(mesh: Path, source: Path, blender: str | None) -> list[str]:
    """Return what other programs say of a written mesh and do not say of its source."""
    found = []
    if mesh.suffix in (".glb", ".gltf"):
        from gltf_kit.gltf_validator import ERROR, WARNING, issues, new_issues

        raised = new_issues(source, mesh) if source.suffix in (".glb", ".gltf") else issues(mesh)[0]
        found += [f"validator: {issue['code']}" for issue in raised if issue["severity"] in (ERROR, WARNING)]
        before = read_by_three(source) if source.suffix in (".glb", ".gltf") else []
        found += [f"three.js: {line}" for line in read_by_three(mesh) if line not in before]
    if mesh.suffix.startswith(".usd"):
        before = validated(source) if source.suffix.startswith(".usd") else []
        found += [f"USD: {line}" for line in validated(mesh) if line not in before]
    if blender is not None:
        before, after = (imported(path, blender) for path in (source, mesh))
        found += [f"Blender: {line}" for line in after if line not in before]
    return found


def validated(path: Path) -> list[str]:
    """Return what the validators of USD find in a stage."""
    from pxr import Usd, UsdValidation

    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return sorted({str(error.GetIdentifier()) for error in context.Validate(Usd.Stage.Open(str(path)))})


def read_by_three(path: Path) -> list[str]:
    """Return what three.js' GLTFLoader says of a file."""
    script = Path(__file__).with_name("read_with_three.mjs").read_text(encoding="utf-8")
    command = ["node", "--input-type=module", "-", str(path)]
    done = subprocess.run(command, input=script, capture_output=True, text=True, cwd=ROOT / "viewer", timeout=60)
    return [*done.stdout.splitlines(), *done.stderr.splitlines()[-1:]]


IMPORT = """
import bpy, sys
path = sys.argv[-1]
bpy.ops.wm.read_factory_settings(use_empty=True)
kind = path.rsplit(".", 1)[-1]
load = {"obj": bpy.ops.wm.obj_import, "ply": bpy.ops.wm.ply_import, "stl": bpy.ops.wm.stl_import}
load.get(kind, bpy.ops.import_scene.gltf)(filepath=path)
print("meshes:", sum(thing.type == "MESH" for thing in bpy.data.objects) > 0)
for image in bpy.data.images:
    if image.source == "FILE" and not image.has_data and not image.size[0]:
        print("no picture", image.name)
"""


def imported(path: Path, blender: str) -> set[str]:
    """Return the warnings and errors of Blender's importer, without paths."""
    if path.suffix not in (".obj", ".ply", ".stl", ".glb", ".gltf"):
        return set()
    done = subprocess.run(
        [blender, "-c", IMPORT, str(path)], capture_output=True, text=True, errors="replace", timeout=300
    )
    lines = (done.stdout + done.stderr).splitlines()
    words = ("error", "warning", "no picture", "meshes: false", "traceback")
    found = {line.replace(str(path), "").strip() for line in lines if any(word in line.lower() for word in words)}
    return found | ({f"exit code {done.returncode}"} if done.returncode else set())


def main() -> None:
    """Run the rows and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, metavar="SRC", help="the `src` of an older checkout, for comparison")
    parser.add_argument("--readers", action="store_true", help="let other programs read what was written")
    parser.add_argument("--blender", metavar="PYTHON", help="an interpreter that has bpy, for --readers")
    parser.add_argument("--folder", type=Path, help="where inputs and outputs stay; by default they are removed")
    parser.add_argument("--only", default="", metavar="WORD", help="run the rows whose names have this word")
    given = parser.parse_args()
    sources = {"now": ROOT / "src"} | ({"before": given.before.resolve()} if given.before else {})
    table = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.folder or Path(scratch)).resolve()
        for number, row in enumerate(row for row in ROWS if given.only.lower() in row.kind.lower()):
            entry = {"kind": row.kind, "command": f"aoprecalc bake MESH -o OUT/ {row.options}", "right": row.right}
            for name, source in sources.items():
                answer, mesh = run(row, source, folder / f"{number:02} {name}")
                entry[name] = told_value(row, answer)
                if name == "now" and given.readers and answer.mesh is not None:
                    entry["complaints"] = complaints(answer.mesh, mesh, given.blender)
            table.append(entry)
            verdict = "right" if entry["now"] == row.right else "WRONG"
            print(f"{verdict}  {row.kind}: {entry.get('before', '')} -> {entry['now']}", *entry.get("complaints", []))
    if not given.only:
        RESULTS.write_text(json.dumps({"rows": table}, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    wrong = [entry["kind"] for entry in table if entry["now"] != entry["right"] or entry.get("complaints")]
    sys.exit(f"wrong: {', '.join(wrong)}" if wrong else 0)


if __name__ == "__main__":
    main()
