"""What a bake must leave as it was in a glTF document: all but occlusion textures, their UVs and missing normals."""

from itertools import count

import numpy as np

from gltf_kit.gltf_values import VARIANTS, GltfValues, holders, is_surface

INSTANCING, QUANTIZATION = "EXT_mesh_gpu_instancing", "KHR_mesh_quantization"
FEATURES = "EXT_mesh_features"
PLACED = ("bufferView", "byteOffset", "count", "min", "max", "sparse")  # of an accessor; the rest tells what it holds
POOLS = ("textures", "images", "samplers")
RESOLVED = ("accessors", "bufferViews", "buffers", "meshes", *POOLS, "extensionsUsed", "extensionsRequired")


def differences(before: GltfValues, after: GltfValues, *, new_normals: bool = False) -> list[str]:
    """Where `after` is not what a bake may make of `before`, each as a path: "/nodes/0/mesh/name: is 'a', was 'b'".

    Vertices may be split and reordered: attributes, morph targets and feature ids are compared at the corners of every
    triangle.
    Meshes and materials may be doubled: what each node and each primitive shows is compared.

    new_normals   others than the document's were asked for
    """
    old, new = _kept(before, new_normals), _kept(after, new_normals)
    for old_one, new_one in zip(old["animations"], new["animations"], strict=False):
        new_one["channels"] = new_one["channels"][: len(old_one["channels"])]  # the rest is of copies
    new["materials"] = new["materials"][: len(old["materials"])]
    return list(_unlike(old, new)) + _gone_from_pools(before, after) + _extensions_unlike(before, after, new_normals)


def replaceable_sets(document, primitive):
    """The TEXCOORD_n that new UVs may replace: the first two are taken, and only replaced occlusion needs it."""
    metadata = document.json.get("extensions", {}).get("EXT_structural_metadata", {}).get("propertyTextures", [])
    own = primitive.get("extensions", {})
    needing = [own, *(metadata[index] for index in own.get("EXT_structural_metadata", {}).get("propertyTextures", []))]
    for material in map(document.material, holders(primitive)):
        lit = "KHR_materials_unlit" not in material.get("extensions", {})
        needing.append({key: value for key, value in material.items() if not (lit and key == "occlusionTexture")})
    needed = set(_sets(needing)).union(*primitive.get("targets", []))
    free = [name for name in ("TEXCOORD_1", "TEXCOORD_0") if name not in needed]
    return set(free[:1]) if {"TEXCOORD_0", "TEXCOORD_1"} <= primitive["attributes"].keys() else set()


def _sets(value):
    """The TEXCOORD_n to which textureInfos in a JSON value refer."""
    if isinstance(value, dict):
        yield from [f"TEXCOORD_{value.get('texCoord', 0)}"] if {"index", "texCoord"} & value.keys() else []
        value = list(value.values())
    for member in value if isinstance(value, list) else []:
        yield from _sets(member)


def _kept(document, new_normals):
    """All that a bake keeps, as one tree of plain values, with what numbers stand for in their place."""
    json = document.json
    shown = {node.get("mesh") for node in json["nodes"]}
    return {key: value for key, value in json.items() if key not in RESOLVED} | {
        "nodes": [_node(document, node, new_normals) for node in json["nodes"]],
        "meshes of no node": {
            index: _mesh(document, mesh, new_normals) for index, mesh in enumerate(json["meshes"]) if index not in shown
        },
        "materials": [_material(document, material) for material in json.get("materials", [])],
        "skins": [_with_values(document, skin, "inverseBindMatrices") for skin in json.get("skins", [])],
        "animations": [
            animation | {"samplers": [_with_values(document, one, "input", "output") for one in animation["samplers"]]}
            for animation in json.get("animations", [])
        ],
    }


def _node(document, node, new_normals):
    node = dict(node)
    if "mesh" in node:
        node["mesh"] = _mesh(document, document.json["meshes"][node["mesh"]], new_normals)
    if INSTANCING in node.get("extensions", {}):
        instances = node["extensions"][INSTANCING]
        values = {name: _values(document, index) for name, index in instances["attributes"].items()}
        node["extensions"] = node["extensions"] | {INSTANCING: instances | {"attributes": values}}
    return node


def _mesh(document, mesh, new_normals):
    return mesh | {"primitives": [_primitive(document, primitive, new_normals) for primitive in mesh["primitives"]]}


def _primitive(document, primitive, new_normals):
    kept = {key: value for key, value in primitive.items() if key not in ("mode", "attributes", "targets", "indices")}
    kept["material"] = _material(document, document.material(primitive))
    if VARIANTS in primitive.get("extensions", {}):
        variants = primitive["extensions"][VARIANTS]
        mappings = [one | {"material": _material(document, document.material(one))} for one in variants["mappings"]]
        kept["extensions"] = primitive["extensions"] | {VARIANTS: variants | {"mappings": mappings}}
    if FEATURES in primitive.get("extensions", {}) and is_surface(primitive):
        ids = [_with_ids(document, primitive, one) for one in primitive["extensions"][FEATURES]["featureIds"]]
        kept["extensions"] = kept["extensions"] | {FEATURES: primitive["extensions"][FEATURES] | {"featureIds": ids}}
    return kept | (_surface(document, primitive, new_normals) if is_surface(primitive) else _dots(document, primitive))


def _with_ids(document, primitive, feature):
    """Feature ids with their numbers at corners, whether these are those of the vertices or in an attribute."""
    corners = document.corners(primitive)
    if "attribute" in feature:
        name = f"_FEATURE_ID_{feature['attribute']}"
        corners = document.array(primitive["attributes"][name])[corners, 0]
    ids = {} if "texture" in feature else {"ids": corners.astype("<i8")}
    return {key: document.followed(value) for key, value in feature.items() if key != "attribute"} | ids


def _surface(document, primitive, new_normals):
    corners = document.corners(primitive)
    omitted = replaceable_sets(document, primitive) | ({"NORMAL", "TANGENT"} if new_normals else set())

    def at_corners(attributes):
        return {name: _values(document, at, corners) for name, at in attributes.items() if name not in omitted}

    return {
        "attributes": at_corners(primitive["attributes"]),
        "targets": [at_corners(target) for target in primitive.get("targets", [])],
    }


def _dots(document, primitive):
    """Points or lines, which are to stay vertex by vertex."""
    vertices = {name: _values(document, index) for name, index in primitive["attributes"].items()}
    indices = _values(document, primitive["indices"]) if "indices" in primitive else None
    return {"mode": primitive["mode"], "vertices": vertices, "indices": indices}


def _material(document, material):
    return document.followed({key: value for key, value in material.items() if key != "occlusionTexture"})


def _with_values(document, entry, *names):
    return entry | {name: _values(document, entry[name]) for name in names if name in entry}


def _values(document, index, rows=slice(None)):
    accessor = document.json["accessors"][index]
    said = {key: value for key, value in accessor.items() if key not in PLACED}
    return said | {"values": document.array(index)[rows]}


def _unlike(before, after, at=""):
    """Yield where two trees differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in {**before, **after}:
            if key not in after:
                yield f"{at}/{key}: is gone"
            elif key in before:
                yield from _unlike(before[key], after[key], f"{at}/{key}")
            elif not (at.endswith("/attributes") and key.startswith(("NORMAL", "TEXCOORD_", "_FEATURE_ID_"))):
                yield f"{at}/{key}: is new"
    elif isinstance(before, list | tuple) and isinstance(after, list | tuple):
        if len(before) != len(after):
            yield f"{at}: has {len(after)} entries, had {len(before)}"
        for index, old, new in zip(count(), before, after, strict=False):
            yield from _unlike(old, new, f"{at}/{index}")
    elif isinstance(before, np.ndarray):
        if before.shape != after.shape or before.dtype != after.dtype or before.tobytes() != after.tobytes():
            yield f"{at}: has other values"
    elif type(before) is not type(after) or before != after:
        yield f"{at}: is {str(after)[:60]}, was {str(before)[:60]}"


def _gone_from_pools(before, after):
    """Textures, images and samplers that are there no more, but for those of replaced occlusion textures."""
    infos = [
        material["occlusionTexture"] for material in before.json.get("materials", []) if "occlusionTexture" in material
    ]
    textures = [before.json["textures"][info["index"]] for info in infos]
    may_go = {
        "textures": {info["index"] for info in infos},
        "images": {texture.get("source") for texture in textures},
        "samplers": {texture.get("sampler") for texture in textures},
    }
    contents = {
        "textures": GltfValues.texture,
        "images": GltfValues.image,
        "samplers": lambda document, index: document.json["samplers"][index],
    }
    found = []
    for kind, content in contents.items():
        left = [content(after, index) for index in range(len(after.json.get(kind, [])))]
        for index in range(len(before.json.get(kind, []))):
            if index not in may_go[kind] and content(before, index) not in left:
                found.append(f"/{kind}/{index}: is gone")
    return found


def _extensions_unlike(before, after, new_normals):
    """Names that joined the lists of extensions, or left them although something still needs them."""
    used, still_used = set(_extensions(before.json)), set(_extensions(after.json))
    found = []
    for kind in ("extensionsUsed", "extensionsRequired"):
        old, new = (set(document.json.get(kind, [])) for document in (before, after))
        found += [f"/{kind}: {name} is new" for name in sorted(new - old)]
        done_with = used - still_used | ({QUANTIZATION} if new_normals else set())
        found += [f"/{kind}: {name} is gone" for name in sorted(old - new - done_with)]
    return found


def _extensions(value):
    if isinstance(value, dict):
        yield from value.get("extensions", {})
    if isinstance(value, dict | list):
        for member in value.values() if isinstance(value, dict) else value:
            yield from _extensions(member)
