"""Small valid glTF documents, one for each thing that a bake must not lose or break.

    DOCUMENTS[name](maker)      builds one in a GltfMaker

All show the same corner of a room: a floor at z = 0 and a wall at x = 0.
"""

from collections.abc import Callable

import numpy as np

from gltf_kit.gltf_maker import GltfMaker, data_uri

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], "<f4")
NORMALS = np.repeat(np.array([[0, 0, 1], [1, 0, 0]], "<f4"), 4, axis=0)
STACKED = np.tile(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4"), (2, 1))  # two faces at each place: no bake
APART = (STACKED * 0.375 + np.repeat(np.array([[0.0625, 0.0625], [0.5625, 0.5]]), 4, axis=0)).astype("<f4")
TRIANGLES = np.array([0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7], "<u2")
CHECKS = np.kron([[1, 0], [0, 1]], np.ones((4, 4)))[:, :, None] * (200, 150, 100) + 20
BLUES = np.full((8, 8, 3), (128, 128, 255))

DOCUMENTS: dict[str, Callable[[GltfMaker], None]] = {}


def document(build):
    DOCUMENTS[build.__name__] = build
    return build


def corner(maker, *uv_sets, normals=NORMALS, triangles=TRIANGLES, **members):
    """A primitive of the corner's 8 vertices; `members` beside its attributes and indices."""
    attributes = {"POSITION": maker.vertices(POINTS, bounds=True)}
    if normals is not None:
        attributes["NORMAL"] = maker.vertices(normals)
    attributes |= {f"TEXCOORD_{number}": maker.vertices(uvs) for number, uvs in enumerate(uv_sets)}
    return {"attributes": attributes, "indices": maker.indices(triangles), **members}


def colored(maker, red=0.5, **members):
    return maker.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [red, 0.5, 0.25, 1]}, **members})


def pictured(maker, place="view", pixels=CHECKS, uv_set=0, **members):
    info = {"index": maker.texture(pixels, place), **({"texCoord": uv_set} if uv_set else {})}
    return maker.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": info}, **members})


def extend(maker, *names, required=False):
    for kind in ("extensionsUsed", "extensionsRequired")[: 1 + required]:
        maker.json.setdefault(kind, []).extend(names)


@document
def materials_and_primitives(maker):
    picture, plain = pictured(maker, name="picture"), colored(maker, name="plain", extras={"of": "ours"})
    both = maker.mesh(corner(maker, STACKED, material=picture), corner(maker, material=plain), corner(maker))
    lights = pictured(maker, emissiveTexture={"index": maker.texture(BLUES), "texCoord": 1})
    more = maker.mesh(corner(maker, STACKED, APART, material=lights), corner(maker, STACKED, material=plain))
    maker.node(mesh=both)
    maker.node(mesh=more, translation=[3, 0, 0])


@document
def instances_under_different_nodes(maker):
    mesh = maker.mesh(corner(maker, STACKED, material=pictured(maker)), name="shared", extras={"n": 1})
    inner = maker.node(mesh=mesh, name="inner", rotation=[0, 0, 0.6, 0.8])
    maker.node(name="outer", children=[inner], translation=[5, 0, 0])
    maker.node(mesh=mesh, name="alone")
    maker.node(mesh=mesh, name="squeezed", matrix=[1, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 2, 0, 0, 5, 0, 1])


@document
def nested_mirrors(maker):
    mesh = maker.mesh(corner(maker, STACKED, material=pictured(maker)))
    inner = maker.node(mesh=mesh, scale=[1, -2, 1], translation=[0, 3, 0])
    middle = maker.node(mesh=mesh, children=[inner], rotation=[0.6, 0, 0, 0.8])
    maker.node(children=[middle], scale=[-1, 1, 1])


@document
def skin(maker):
    primitive = corner(maker, STACKED, material=pictured(maker))
    bent = np.array([0, 0, 0, 0, 0.5, 0.5, 1, 1])
    joints, weights = np.zeros((8, 4), "<u1"), np.zeros((8, 4), "<f4")
    joints[bent == 0.5, 1] = joints[bent == 1, 0] = 1
    weights[:, 0], weights[bent == 0.5, 1] = np.where(bent == 1, 1, 1 - bent), 0.5
    primitive["attributes"] |= {"JOINTS_0": maker.vertices(joints), "WEIGHTS_0": maker.vertices(weights)}
    knee = maker.node(name="knee", translation=[0, 0, 0.5], rotation=[0, 0.6, 0, 0.8])
    hip = maker.node(name="hip", children=[knee], scale=[1, 2, 1])
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[1, 3, 2] = -0.5  # column-major
    matrices = maker.accessor(inverse.reshape(2, 16), name="inverse")
    maker.add("skins", {"joints": [hip, knee], "inverseBindMatrices": matrices, "skeleton": hip, "name": "leg"})
    maker.node(mesh=maker.mesh(primitive), skin=0)


@document
def morph_targets(maker):
    primitive = corner(maker, STACKED, material=pictured(maker, normalTexture={"index": maker.texture(BLUES)}))
    tangents = np.tile(np.array([[0, 1, 0, -1]], "<f4"), (8, 1))
    primitive["attributes"]["TANGENT"] = maker.vertices(tangents)
    rises = np.linspace(0, 0.5, 24, dtype="<f4").reshape(8, 3)
    lone, none = np.zeros((2, 8, 3), "<f4")
    lone[[2, 6]] = [[0, 0, 0.25], [0.5, 0, 0]]
    primitive["targets"] = [
        {"POSITION": maker.vertices(rises, bounds=True), "NORMAL": maker.vertices(rises[::-1].copy())},
        {"POSITION": maker.sparse(lone, None), "NORMAL": maker.sparse(lone, none), "TANGENT": maker.vertices(rises)},
    ]
    mesh = maker.mesh(primitive, weights=[0.5, 0.25], extras={"targetNames": ["rise", "lone"]})
    maker.node(mesh=mesh)
    maker.node(mesh=mesh, weights=[0, 1], translation=[0, 3, 0])
    maker.node(mesh=mesh, translation=[0, 6, 0])
    animate(maker, 0, "weights", np.array([0, 1, 1, 0], "<f4"))


def animate(maker, node, path, values, **members):
    """An animation of two keys."""
    times = maker.accessor(np.array([0, 1], "<f4"), min=[0], max=[1])
    sampler = {"input": times, "output": maker.accessor(values), "interpolation": "LINEAR"}
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    maker.add("animations", {"channels": [channel], "samplers": [sampler], **members})


def transformed(texture, **members):
    return {"index": texture, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "offset": [0.5, 0], **members}}}


@document
def transformed_textures(maker):
    extend(maker, "KHR_texture_transform")
    picture = maker.texture(CHECKS, sampler={"wrapS": 33648, "minFilter": 9987})
    before = transformed(maker.texture(BLUES), texCoord=1) | {"strength": 0.5}
    material = {"pbrMetallicRoughness": {"baseColorTexture": transformed(picture)}, "occlusionTexture": before}
    primitive = corner(maker, STACKED, STACKED, material=maker.add("materials", material))
    maker.node(mesh=maker.mesh(primitive))


@document
def a_transform_that_only_occlusion_requires(maker):
    extend(maker, "KHR_texture_transform", required=True)
    material = {"occlusionTexture": transformed(maker.texture(BLUES))}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=maker.add("materials", material))))


@document
def occlusion_packed_with_roughness(maker):
    packed = {"index": maker.texture(CHECKS)}
    material = {"pbrMetallicRoughness": {"metallicRoughnessTexture": packed}, "occlusionTexture": packed}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=maker.add("materials", material))))


@document
def quantized(maker):
    extend(maker, "KHR_mesh_quantization", required=True)
    short, byte, ushort = (np.iinfo(kind).max for kind in ("<i2", "<i1", "<u2"))
    attributes = {
        "POSITION": maker.vertices((POINTS * short).astype("<i2"), bounds=True, normalized=True),
        "NORMAL": maker.vertices((NORMALS * byte).astype("<i1"), normalized=True),
        "TEXCOORD_0": maker.vertices((STACKED * ushort).astype("<u2"), normalized=True),
    }
    primitive = {"attributes": attributes, "indices": maker.indices(TRIANGLES), "material": pictured(maker)}
    maker.node(mesh=maker.mesh(primitive), scale=[3, 3, 3])


@document
def quantized_normals(maker):
    extend(maker, "KHR_mesh_quantization", required=True)
    primitive = corner(maker, normals=None)
    primitive["attributes"]["NORMAL"] = maker.vertices((NORMALS * 127).astype("<i1"), normalized=True)
    maker.node(mesh=maker.mesh(primitive))


@document
def sparse_attributes(maker):
    attributes = {
        "POSITION": maker.sparse(POINTS, base=POINTS * np.array([1, 1, 0], "<f4")),
        "NORMAL": maker.sparse(NORMALS, base=None),
        "TEXCOORD_0": maker.sparse(STACKED, base=STACKED[::-1]),
    }
    primitive = {"attributes": attributes, "indices": maker.indices(TRIANGLES), "material": pictured(maker)}
    maker.node(mesh=maker.mesh(primitive))


@document
def interleaved(maker):
    rows = np.hstack([POINTS, NORMALS, STACKED])
    view = maker.view(rows.tobytes(), byteStride=32, target=34962)
    attributes = {
        "POSITION": maker.accessor(POINTS, bufferView=view, min=[0, 0, 0], max=[1, 1, 1]),
        "NORMAL": maker.accessor(NORMALS, bufferView=view, byteOffset=12),
        "TEXCOORD_0": maker.accessor(STACKED, bufferView=view, byteOffset=24),
    }
    primitive = {"attributes": attributes, "indices": maker.indices(TRIANGLES), "material": pictured(maker)}
    maker.node(mesh=maker.mesh(primitive))


@document
def data_uris(maker):
    primitive = corner(maker, material=pictured(maker, "data"))
    data = STACKED.tobytes()
    maker.further_buffers = [{"byteLength": len(data), "uri": data_uri(data, "application/octet-stream")}]
    view = maker.add("bufferViews", {"buffer": 1, "byteLength": len(data), "target": 34962})
    primitive["attributes"]["TEXCOORD_0"] = maker.accessor(STACKED, bufferView=view)
    maker.node(mesh=maker.mesh(primitive))


@document
def variants(maker):
    extend(maker, "KHR_materials_variants", "KHR_materials_unlit")
    maker.json["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}}
    day, night = colored(maker, 0.75), colored(maker, 0.25, extensions={"KHR_materials_unlit": {}})
    mappings = [{"material": day, "variants": [0]}, {"material": night, "variants": [1]}]
    chosen = {"material": pictured(maker), "extensions": {"KHR_materials_variants": {"mappings": mappings}}}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, **chosen)))
    maker.node(mesh=maker.mesh(corner(maker, material=day)), translation=[0, 3, 0])


@document
def a_mask_with_a_picture_beside(maker):
    leaves = np.dstack([CHECKS, np.where(CHECKS[:, :, 0] > 100, 255, 0)])
    mask = pictured(maker, "the leaves.png", leaves, alphaMode="MASK", alphaCutoff=0.25)
    maker.json["images"][0]["uri"] = "the%20leaves.png"
    primitive = corner(maker, STACKED, material=mask)
    primitive["attributes"]["COLOR_0"] = maker.vertices(np.linspace(0.5, 1, 32, dtype="<f4").reshape(8, 4))
    maker.node(mesh=maker.mesh(primitive))


@document
def blend_and_transmission(maker):
    extend(maker, "KHR_materials_transmission")
    glass = colored(maker, extensions={"KHR_materials_transmission": {"transmissionFactor": 0.5}})
    smoke = colored(maker, alphaMode="BLEND", doubleSided=True)
    for height, material in enumerate((glass, smoke, colored(maker))):
        maker.node(mesh=maker.mesh(corner(maker, material=material)), translation=[0, 0, height / 2])


@document
def unlit(maker):
    extend(maker, "KHR_materials_unlit")
    sign = pictured(maker, extensions={"KHR_materials_unlit": {}})
    lit = corner(maker, STACKED, material=pictured(maker))
    maker.node(mesh=maker.mesh(lit | {"material": sign}, lit, corner(maker, STACKED, material=sign)))


@document
def points_and_lines(maker):
    material = colored(maker, name="ink")
    surface = corner(maker, material=material)
    attributes = {"POSITION": surface["attributes"]["POSITION"]}
    dots = {"attributes": attributes, "mode": 0, "material": material}
    wires = [
        {"attributes": attributes, "indices": maker.indices(np.array(rows, "<u1")), "mode": mode, "material": material}
        for mode, rows in ((1, [0, 1, 2, 3]), (2, [4, 5, 6, 7]), (3, [0, 2, 4]))
    ]
    maker.node(mesh=maker.mesh(dots, surface, *wires, {"attributes": attributes, "mode": 0}))


@document
def strips_and_fans(maker):
    material = pictured(maker)
    joined = np.array([0, 1, 3, 2, 2, 4, 4, 5, 7, 6], "<u1")  # floor and wall, over triangles of no area
    strip = corner(maker, STACKED, triangles=joined, mode=5, material=material)
    fan = corner(
        maker, STACKED, triangles=np.array([4, 5, 6, 7], "<u4"), mode=6, material=material, extras={"a": "fan"}
    )
    maker.node(mesh=maker.mesh(strip, fan))
    attributes = {"POSITION": maker.vertices(POINTS[:4], bounds=True), "NORMAL": maker.vertices(NORMALS[:4])}
    maker.node(mesh=maker.mesh({"attributes": attributes, "mode": 6}), translation=[0, 0, -1])


@document
def double_sided(maker):
    maker.node(mesh=maker.mesh(corner(maker, STACKED, material=pictured(maker, doubleSided=True))))


@document
def colors_tangents_and_own_attributes(maker):
    material = pictured(maker, normalTexture={"index": maker.texture(BLUES)})
    primitive = corner(maker, STACKED, material=material)
    count = np.arange(8)
    primitive["attributes"] |= {
        "TANGENT": maker.vertices(np.array([[0, 1, 0, 1], [0, 0, 1, -1]], "<f4").repeat(4, axis=0)),
        "COLOR_0": maker.vertices((count[:, None] * (30, 20, 10, 1) + 40).astype("<u1"), normalized=True),
        "COLOR_1": maker.vertices((count[:, None] * (0.1, 0.05, 0.01)).astype("<f4")),
        "_X": maker.vertices((count * 3).astype("<u2"), name="ours", extras={"unit": "m"}),
        "_Y": maker.vertices((count[:, None] * (1, -1, 5)).astype("<i1")),
    }
    maker.node(mesh=maker.mesh(primitive))


@document
def two_uv_sets(maker):
    lights = {"index": maker.texture(BLUES), "texCoord": 1}
    maker.node(mesh=maker.mesh(corner(maker, STACKED, STACKED, material=pictured(maker, emissiveTexture=lights))))


@document
def a_second_set_that_nothing_needs(maker):
    maker.node(mesh=maker.mesh(corner(maker, STACKED, STACKED, material=pictured(maker))))


@document
def uvs_that_hold_a_bake(maker):
    maker.node(mesh=maker.mesh(corner(maker, APART, material=pictured(maker))))


@document
def a_second_set_that_holds_a_bake(maker):
    material = pictured(maker, emissiveTexture={"index": maker.texture(BLUES), "texCoord": 1})
    maker.node(mesh=maker.mesh(corner(maker, STACKED, APART, material=material)))


@document
def uvs_that_hold_a_bake_without_normals(maker):
    maker.node(mesh=maker.mesh(corner(maker, APART, normals=None, material=pictured(maker))))


@document
def much_beside_the_mesh(maker):
    extras = {"anything": [1, {"two": None}], "ä": "ö"}
    ours = {"EXT_of_ours": {"anything": [1.5, {"two": None}], "ä": "ö"}}  # a whole number might be that of an accessor
    extend(maker, "EXT_of_ours", "KHR_lights_punctual")
    maker.json["asset"] |= {"generator": "someone", "copyright": "hers", "extras": extras}
    lamp = {"type": "spot", "spot": {"outerConeAngle": 0.5}, "name": "lamp", "intensity": 3}
    maker.json |= {"extras": extras, "extensions": ours | {"KHR_lights_punctual": {"lights": [lamp]}}}
    maker.add(
        "cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}, "name": "eye", "extras": extras}
    )
    material = pictured(maker, name="paint", extras=extras, extensions=ours, emissiveFactor=[0, 0, 1])
    maker.json["textures"][0] |= {"name": "checks", "extras": extras}
    maker.json["images"][0]["extras"] = extras
    primitive = corner(maker, STACKED, material=material, extras=extras, extensions=ours)
    eye = maker.node(camera=0, name="eye", extras=extras)
    lamp = maker.node(name="lamp", extensions={"KHR_lights_punctual": {"light": 0}})
    mesh = maker.mesh(primitive, name="mesh", extras=extras, extensions=ours)
    maker.node(mesh=mesh, name="both", children=[eye, lamp], extras=extras, extensions=ours)
    maker.node(mesh=mesh, name="both", translation=[0, 3, 0])
    animate(maker, 2, "translation", POINTS[:2], name="walk", extras=extras)
    animate(maker, 2, "rotation", np.array([[0, 0, 0, 127], [0, 0, 127, 0]], "<i1"))
    maker.json["accessors"][-1]["normalized"] = True


@document
def several_scenes(maker):
    mesh = maker.mesh(corner(maker, STACKED, material=pictured(maker)))
    for name in ("in the first", "in the second"):
        maker.node(mesh=mesh, name=name)
    maker.node(mesh=maker.mesh(corner(maker)), name="in the first as well", translation=[0, 3, 0])
    maker.json |= {"scene": 1, "scenes": [{"nodes": [0, 2], "name": "first"}, {"nodes": [1], "name": "second"}]}


@document
def bare(maker):
    maker.node(mesh=maker.mesh({"attributes": {"POSITION": maker.vertices(POINTS[TRIANGLES], bounds=True)}}))


@document
def gpu_instancing(maker):
    extend(maker, "EXT_mesh_gpu_instancing", required=True)
    places = {"TRANSLATION": maker.accessor(POINTS * 4), "_ID": maker.accessor(np.arange(8, dtype="<f4"))}
    mesh = maker.mesh(corner(maker, STACKED, material=pictured(maker)))
    maker.node(mesh=mesh, extensions={"EXT_mesh_gpu_instancing": {"attributes": places}})
    maker.node(mesh=mesh, translation=[0, 9, 0])


@document
def shared_accessors(maker):
    first = corner(maker, STACKED, material=pictured(maker))
    first["attributes"]["_X"] = maker.vertices(np.arange(8, dtype="<f4"), name="named", extras={"of": "both"})
    second = first | {"indices": maker.indices(TRIANGLES[::-1].copy())}
    maker.node(mesh=maker.mesh(first, second))
    maker.node(mesh=maker.mesh(first), translation=[0, 3, 0])


@document
def faces_without_area(maker):
    triangles = np.append(TRIANGLES, [1, 1, 2, 3, 3, 3]).astype("<u4")
    surface = corner(maker, APART, triangles=triangles, material=pictured(maker))
    needle = {"attributes": {"POSITION": maker.vertices(POINTS[[0, 1, 1]], bounds=True)}, "material": colored(maker)}
    maker.node(mesh=maker.mesh(surface, needle))


@document
def things_that_nothing_uses(maker):
    maker.mesh(corner(maker, STACKED, material=pictured(maker)), name="never shown")
    colored(maker, occlusionTexture={"index": maker.texture(BLUES)})
    maker.texture(BLUES[:4])
    maker.accessor(POINTS, name="never read")
    maker.node(mesh=maker.mesh(corner(maker)))
    maker.node(mesh=0, name="in no scene")
    maker.json |= {"scene": 0, "scenes": [{"nodes": [0]}]}
