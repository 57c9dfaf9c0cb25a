"""Random glTF documents, valid ones, in which the features of glTF meet that hang on vertices, materials and UV sets.

random_document(maker, seed)      fills a GltfMaker; the same for the same seed
"""

from itertools import pairwise

import numpy as np

from gltf_kit.gltf_documents import BLUES, CHECKS, animate, extend
from gltf_kit.gltf_maker import ARRAY, GltfMaker

VERTICES, JOINTS = 12, 8
EXTRAS = {"anything": ["ours", {"two": None}], "ä": 0.5}
NAMES = [f"KHR_{name}" for name in ("texture_transform", "animation_pointer", "xmp_json_ld", "lights_punctual")]
NAMES += [f"KHR_materials_{name}" for name in ("variants", "unlit", "clearcoat")]
NAMES += [f"EXT_{name}" for name in ("mesh_features", "structural_metadata", "mesh_gpu_instancing")]


def random_document(maker: GltfMaker, seed: int) -> None:
    _Random(maker, np.random.default_rng(seed)).build()


class _Random:
    def __init__(self, maker, rng):
        self.maker, self.rng = maker, rng
        self.quantized = self.chance(0.4)
        self.sets = int(rng.integers(0, 4))  # at most, of UVs

    def chance(self, probability=0.5):
        return self.rng.random() < probability

    def some(self, *values):
        return values[self.rng.integers(len(values))]

    def maybe(self, probability=0.3, **members):
        return members if self.chance(probability) else {}

    def build(self):
        maker = self.maker
        extend(maker, *NAMES)
        if self.quantized:
            extend(maker, "KHR_mesh_quantization", required=True)
        maker.json |= self.maybe(extras=EXTRAS)
        maker.json["asset"] |= self.maybe(extras=EXTRAS, generator="someone")
        schema = {"classes": {"a": {"properties": {"heat": {"type": "SCALAR", "componentType": "UINT8"}}}}}
        heat = {"class": "a", "properties": {"heat": {"attribute": "_HEAT"}}}
        seen = {"class": "a", "properties": {"heat": self.info(self.sets) | {"channels": [0]}}}
        table = maker.view(np.arange(3, dtype="<u1").tobytes())
        tables = [{"class": "a", "count": 3, "properties": {"heat": {"values": table}}}]
        maker.json["extensions"] = {
            "EXT_structural_metadata": {
                "schema": {"id": "s", **schema},
                "propertyAttributes": [heat],
                "propertyTextures": [seen],
                "propertyTables": tables,
            },
            "KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]},
            "KHR_xmp_json_ld": {"packets": [{"@context": {"dc": "http://purl.org/dc/elements/1.1/"}, "dc:title": "x"}]},
            "KHR_lights_punctual": {"lights": [{"type": "point"}]},
        }
        for _ in range(self.rng.integers(1, 4)):
            maker.add("materials", self.material())
        meshes = [self.mesh() for _ in range(self.rng.integers(1, 4))]
        self.nodes(meshes)
        self.animations()

    # Materials.

    def info(self, sets, **members):
        texture = self.maker.texture(self.some(CHECKS, BLUES), self.some("view", "data"))
        info = {"index": texture, "texCoord": int(self.rng.integers(max(sets, 1)))} | members
        if self.chance(0.3):
            transform = {"offset": [0.25, 0.5]} | self.maybe(texCoord=int(self.rng.integers(max(sets, 1))))
            info["extensions"] = {"KHR_texture_transform": transform}
        return info

    def material(self):
        if not self.sets:
            return self.maybe(extras=EXTRAS, alphaMode="BLEND", doubleSided=True)
        textured = {key: self.info(self.sets) for key in ("normalTexture", "emissiveTexture") if self.chance(0.3)}
        color = {
            key: self.info(self.sets) for key in ("baseColorTexture", "metallicRoughnessTexture") if self.chance(0.4)
        }
        textured |= {"pbrMetallicRoughness": color} if color else {}
        if self.chance(0.4):
            textured["occlusionTexture"] = self.info(self.sets, **self.maybe(strength=0.5), **self.maybe(extras=EXTRAS))
        if self.chance(0.2) and color.get("metallicRoughnessTexture"):
            textured["occlusionTexture"] = dict(color["metallicRoughnessTexture"])
        extensions = self.maybe(0.2, KHR_materials_unlit={}) or self.maybe(
            KHR_materials_clearcoat={"clearcoatFactor": 1, "clearcoatTexture": self.info(self.sets)}
        )
        return {
            **textured,
            **self.maybe(extras=EXTRAS, name="paint"),
            **({"extensions": extensions} if extensions else {}),
        }

    # Meshes.

    def values(self, kind, width, low=-1.0, high=1.0):
        """Values of a vertex attribute, in [low, high] where integers are normalized."""
        values = self.rng.uniform(low, high, (VERTICES, width))
        return values.astype(kind) if kind == "<f4" else np.rint(values * np.iinfo(kind).max).astype(kind)

    def unit(self, kind, width):
        values = self.rng.normal(size=(VERTICES, 3))
        values /= np.linalg.norm(values, axis=1, keepdims=True)
        if width == 4:
            values = np.hstack([values, self.rng.choice([-1, 1], (VERTICES, 1))])
        return values.astype(kind) if kind == "<f4" else np.rint(values * np.iinfo(kind).max).astype(kind)

    def attributes(self, joints):
        """(name, array, members of the accessor) of each attribute."""
        some = self.some
        kind = some("<i2", "<f4") if self.quantized else "<f4"
        yield "POSITION", self.values(kind, 3), {"bounds": True, "normalized": kind != "<f4"}
        if self.chance(0.8):
            kind = some("<i1", "<i2", "<f4") if self.quantized else "<f4"
            yield "NORMAL", self.unit(kind, 3), {"normalized": kind != "<f4"}
            if self.chance():
                kind = some("<i1", "<i2", "<f4") if self.quantized else "<f4"
                yield "TANGENT", self.unit(kind, 4), {"normalized": kind != "<f4"}
        for number in range(self.sets):
            kind = some("<u1", "<u2", "<f4")
            yield f"TEXCOORD_{number}", self.values(kind, 2, 0), {"normalized": kind != "<f4"}
        for number in range(self.rng.integers(3)):
            kind = some("<u1", "<u2", "<f4")
            yield f"COLOR_{number}", self.values(kind, some(3, 4), 0.5), {"normalized": kind != "<f4"}
        for number in range(joints):
            four = np.arange(4) + 4 * number
            yield (
                f"JOINTS_{number}",
                self.rng.permuted(np.tile(four, (VERTICES, 1)), axis=1).astype(some("<u1", "<u2")),
                {},
            )
            yield f"WEIGHTS_{number}", np.full((VERTICES, 4), 0.25 / joints, "<f4"), {}
        if self.chance():
            yield "_HEAT", np.arange(VERTICES, dtype="<u1"), {"name": "heat"} | self.maybe(extras=EXTRAS)
            yield "_FEATURE_ID_0", np.arange(VERTICES, dtype=some("<u1", "<u2", "<f4")) % 5, {}
        if self.chance():
            yield "_ANY", self.values(some("<u1", "<i1", "<u2", "<i2", "<f4"), some(2, 3, 4)), self.maybe(bounds=True)
            yield "_MATRIX", self.values("<f4", 16), {}

    def accessors(self, described, layout):
        """The index of an accessor for each attribute, whose data are apart, interleaved or sparse."""
        maker, found = self.maker, {}
        if layout == "interleaved":
            rows = [np.ascontiguousarray(array).reshape(VERTICES, -1) for _, array, _ in described]
            padded = [np.pad(each.view("u1"), ((0, 0), (0, -each[:1].nbytes % 4))) for each in rows]
            joined = np.hstack(padded)
            if joined.shape[1] <= 252:
                view = maker.view(joined.tobytes(), byteStride=joined.shape[1], target=ARRAY)
                offsets = np.cumsum([0, *(each.shape[1] for each in padded)]).tolist()
                for (name, array, members), offset in zip(described, offsets, strict=False):
                    found[name] = maker.accessor(array, bufferView=view, byteOffset=offset, **_bounded(array, members))
                return found
        for name, array, members in described:
            if (
                layout == "sparse"
                and array.dtype == "<f4"
                and array.ndim == 2
                and not name.startswith(("_", "WEIGHTS"))
            ):
                base = self.some(array[::-1].copy(), np.where(np.arange(VERTICES)[:, None] % 3, array, 0).astype("<f4"))
                kept = {key: value for key, value in members.items() if key not in ("bounds", "normalized")}
                found[name] = maker.sparse(array, base, **kept)
            else:
                found[name] = maker.vertices(array, **_said(members))
        return found

    def mesh(self):
        joints = int(self.some(0, 0, 1, 2))
        targets = int(self.some(0, 0, 1, 3))
        morphed = [name for name in ("POSITION", "NORMAL", "TANGENT", "TEXCOORD_0", "COLOR_0") if self.chance()]
        first = self.primitive(joints, targets, morphed)
        primitives = [first] + [self.primitive(joints, targets, morphed) for _ in range(self.rng.integers(2))]
        if self.chance(0.3):  # shares accessors
            primitives.append(first | self.topology() | self.maybe(material=0))
        if self.chance(0.2) and not targets:
            primitives.append({"attributes": {"POSITION": first["attributes"]["POSITION"]}, "mode": 0})
        members = (
            {"extras": EXTRAS | {"targetNames": [str(at) for at in range(targets)]}}
            if self.chance(0.3) and targets
            else {}
        )
        if targets and self.chance():
            members["weights"] = [float(self.some(0, 0.5)) for _ in range(targets)]
        members |= self.maybe(extensions={"KHR_xmp_json_ld": {"packet": 0}})
        index = self.maker.mesh(*primitives, **members)
        return index, joints, targets

    def topology(self):
        mode = int(self.some(4, 4, 4, 5, 6))
        corners = np.array([self.rng.choice(VERTICES, 3, replace=False) for _ in range(8)]).reshape(-1)
        if mode != 4:
            corners = self.rng.permutation(VERTICES)[: self.rng.integers(3, VERTICES)]
        return {"indices": self.maker.indices(corners.astype(self.some("<u1", "<u2", "<u4"))), "mode": mode}

    def primitive(self, joints, targets, morphed):
        maker = self.maker
        described = list(self.attributes(joints))
        attributes = self.accessors(described, self.some("apart", "apart", "interleaved", "sparse"))
        primitive = {"attributes": attributes, **self.maybe(0.8, **self.topology()), **self.maybe(extras=EXTRAS)}
        primitive |= self.maybe(0.8, material=int(self.rng.integers(len(maker.json["materials"]))))
        widths = {name: array.shape[-1] for name, array, _ in described}
        names = [name for name in morphed if name in attributes] or ["POSITION"]
        if targets:
            primitive["targets"] = [
                {name: self.target(name, 3 if name == "TANGENT" else widths[name]) for name in names}
                for _ in range(targets)
            ]
        extensions = {}
        if self.chance(0.4):
            ids = [{"featureCount": VERTICES}] + (
                [{"featureCount": 5, "attribute": 0}] if "_FEATURE_ID_0" in attributes else []
            )
            if self.sets and self.chance():
                ids.append({"featureCount": 256, "texture": self.info(self.sets) | {"channels": [0]}})
            extensions["EXT_mesh_features"] = {"featureIds": ids}
        if self.chance(0.3):
            extensions["EXT_structural_metadata"] = {"propertyTextures": [0]} | (
                {"propertyAttributes": [0]} if "_HEAT" in attributes else {}
            )
        if self.chance(0.4):
            count = len(maker.json["materials"])
            mappings = [{"material": int(self.rng.integers(count)), "variants": [at]} for at in range(2)]
            extensions["KHR_materials_variants"] = {"mappings": mappings}
        return primitive | ({"extensions": extensions} if extensions else {})

    def target(self, name, width):
        values = self.rng.uniform(-0.1, 0.1, (VERTICES, width)).astype("<f4")
        if self.chance():
            values[self.rng.random(VERTICES) < 0.7] = 0
            values[0] = 0.05
            return self.maker.sparse(values, None)
        return self.maker.vertices(values, bounds=name == "POSITION")

    # Nodes.

    def nodes(self, meshes):
        maker, rng = self.maker, self.rng
        joints = [maker.node(name=f"joint {at}", translation=[0, 0, 0.1]) for at in range(JOINTS)]
        for before, after in pairwise(joints):
            maker.json["nodes"][before]["children"] = [after]
        inverse = np.tile(np.eye(4, dtype="<f4"), (JOINTS, 1, 1)).reshape(JOINTS, 16)
        maker.add(
            "skins", {"joints": joints, "inverseBindMatrices": maker.accessor(inverse)} | self.maybe(extras=EXTRAS)
        )
        maker.add(
            "cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}} | self.maybe(extras=EXTRAS)
        )
        roots = joints[:1]
        for index, bones, targets in meshes:
            for _ in range(rng.integers(1, 3)):
                place = {"translation": rng.uniform(-5, 5, 3).tolist()} | self.maybe(scale=[1, -2, 1])
                place = self.maybe(0.2, matrix=[1, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 2, 0, 0, 5, 0, 1]) or place
                node = place | {"mesh": index} | self.maybe(extras=EXTRAS)
                if targets and self.chance():
                    node["weights"] = [float(self.some(0, 0.5)) for _ in range(targets)]
                if bones:
                    node = {
                        key: value for key, value in node.items() if key not in ("translation", "scale", "matrix")
                    } | {"skin": 0}
                elif self.chance(0.2):
                    attributes = {"TRANSLATION": maker.accessor(rng.uniform(-9, 9, (2, 3)).astype("<f4"))}
                    node["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
                roots.append(maker.node(**node))
        children = [roots.pop()] if self.chance(0.3) and "skin" not in maker.json["nodes"][-1] else []
        lamp = maker.node(camera=0, extensions={"KHR_lights_punctual": {"light": 0}}, name="lamp")
        roots.append(maker.node(children=[lamp, *children], rotation=[0, 0.6, 0, 0.8], extras=EXTRAS))
        maker.json |= {
            "scene": 0,
            "scenes": [{"nodes": roots, "extras": EXTRAS}, *self.some([], [{"nodes": joints[:1]}])],
        }

    def animations(self):
        maker = self.maker
        nodes = maker.json["nodes"]
        animate(maker, 0, "translation", np.zeros((2, 3), "<f4"), name="walk")
        morphed = next((at for at, node in enumerate(nodes) if "mesh" in node and self.targets_of(node)), None)
        if morphed is not None:
            count = self.targets_of(nodes[morphed])
            animate(maker, morphed, "weights", np.linspace(0, 1, 2 * count, dtype="<f4"))
        if self.chance():
            animate(maker, 0, "translation", np.zeros((2, 4), "<f4"))
            pointer = f"/materials/{len(maker.json['materials']) - 1}/pbrMetallicRoughness/baseColorFactor"
            extensions = {"KHR_animation_pointer": {"pointer": pointer}}
            maker.json["animations"][-1]["channels"][0]["target"] = {"path": "pointer", "extensions": extensions}

    def targets_of(self, node):
        return len(self.maker.json["meshes"][node["mesh"]]["primitives"][0].get("targets", []))


def _said(members):
    return {key: value for key, value in members.items() if value is not False}


def _bounded(array, members):
    """Members of an accessor in a view of others, with its bounds where they are asked for."""
    said = {key: value for key, value in _said(members).items() if key != "bounds"}
    rows = array.reshape(VERTICES, -1)
    return said | ({"min": rows.min(0).tolist(), "max": rows.max(0).tolist()} if members.get("bounds") else {})


def compress(maker: GltfMaker, library, name="EXT_meshopt_compression") -> None:
    """Compress the views of vertex data of a document by meshopt, whose Python package is `library`."""
    extend(maker, name, required=True)
    stand_in = 0
    for view in maker.json["bufferViews"]:
        start, length = view["byteOffset"], view["byteLength"]
        stride = view.get("byteStride", 4)
        if view.get("target") != ARRAY or stride > 252 or length % stride:
            continue
        rows = np.frombuffer(maker.data[start : start + length], "u1").reshape(-1, stride)
        stream = library.encode_vertex_buffer(np.ascontiguousarray(rows), len(rows), stride)
        maker.data += bytes(-len(maker.data) % 4)
        place = {"buffer": 0, "byteOffset": len(maker.data), "byteLength": len(stream)}
        packed = {**place, "byteStride": stride, "count": len(rows), "mode": "ATTRIBUTES"}
        maker.data += stream
        view |= {"buffer": 1, "byteOffset": stand_in, "extensions": {name: packed}}
        stand_in += length + -length % 4
    maker.further_buffers = [{"byteLength": stand_in, "extensions": {name: {"fallback": True}}}]
