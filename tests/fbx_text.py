"""FBX 7.4 as text, made by code."""

import base64
from itertools import count

AXES = {"X": 0, "Y": 1, "Z": 2}
HEADER = "; FBX 7.4.0 project file\nFBXHeaderExtension:  {\n\tFBXHeaderVersion: 1003\n\tFBXVersion: 7400\n}\n"


class FbxText:
    """A scene; what is added returns its number.

    up     the axis that points up
    unit   in centimetres
    """

    def __init__(self, up="Y", unit=1.0):
        self._numbers = count(1000)
        self._objects, self._connections = [], []
        front = {"X": "Y", "Y": "Z", "Z": "Y"}[up]
        right = next(axis for axis in "XYZ" if axis not in (up, front))
        self._settings = [
            int_property("UpAxis", AXES[up]),
            int_property("UpAxisSign", 1),
            int_property("FrontAxis", AXES[front]),
            int_property("FrontAxisSign", -1 if up == "Z" else 1),
            int_property("CoordAxis", AXES[right]),
            int_property("CoordAxisSign", 1),
            number_property("UnitScaleFactor", unit),
        ]

    def mesh(self, points, faces, normals=None, uv_sets=(), materials=None):
        """Polygons; `normals` and each of `uv_sets`, (name, values), are at their corners, `materials` of each."""
        ends = [f"{corner}" for face in faces for corner in [*face[:-1], -face[-1] - 1]]
        layers, types = [], []
        if normals is not None:
            layers.append(_layer("LayerElementNormal", 0, "Normals", normals, "ByPolygonVertex"))
            types.append(("LayerElementNormal", 0))
        for number, (name, values) in enumerate(uv_sets):
            indices = list(range(len(values)))
            layers.append(_layer("LayerElementUV", number, "UV", values, "ByPolygonVertex", name, "UVIndex", indices))
            types.append(("LayerElementUV", number))
        if materials is not None:
            layers.append(_layer("LayerElementMaterial", 0, "Materials", [[each] for each in materials], "ByPolygon"))
            types.append(("LayerElementMaterial", 0))
        sets = range(max([number for _, number in types], default=0) + 1)
        stacks = [
            f"Layer: {level} {{\nVersion: 100\n"
            + "".join(f'LayerElement:  {{\nType: "{kind}"\nTypedIndex: {n}\n}}\n' for kind, n in types if n == level)
            + "}\n"
            for level in sets
        ]
        content = _array("Vertices", [c for point in points for c in point]) + _array("PolygonVertexIndex", ends)
        return self._add("Geometry", "Geometry", "", "Mesh", content + "".join([*layers, *stacks]))

    def node(self, name, attribute=None, parent=0, materials=(), kind="Mesh", **properties):
        """A node: `properties` are vectors such as Lcl_Translation, or numbers such as Visibility."""
        lines = [
            _vector_property(key.replace("_", " ") if key.startswith("Lcl") else key, value)
            if isinstance(value, tuple)
            else number_property(key, value)
            for key, value in properties.items()
        ]
        node = self._add("Model", "Model", name, kind, f"Version: 232\n{_properties(lines)}Shading: T\n")
        self.connect(node, parent)
        for each in [*([] if attribute is None else [attribute]), *materials]:
            self.connect(each, node)
        return node

    def lod_group(self):
        """The attribute of a node whose children are levels of detail."""
        return self._add("NodeAttribute", "NodeAttribute", "", "LodGroup", 'TypeFlags: "LodGroup"\n')

    def material(self, name, shading="phong", **properties):
        """A classic material."""
        lines = [
            _vector_property(key, value, "Color") if isinstance(value, tuple) else number_property(key, value)
            for key, value in properties.items()
        ]
        content = f'Version: 102\nShadingModel: "{shading}"\n{_properties(lines)}'
        return self._add("Material", "Material", name, "", content)

    def texture(self, file, material, slot="DiffuseColor", uv_set="", data=None, scale=(1, 1), offset=(0, 0)):
        """A picture of a material, embedded where it has data."""
        lines = [
            f'P: "UVSet", "KString", "", "", "{uv_set}"\n',
            _vector_property("Scaling", (*scale, 1)),
            _vector_property("Translation", (*offset, 0)),
        ]
        names = f'FileName: "C:\\work\\{file}"\nRelativeFilename: "{file}"\n'
        texture = self._add("Texture", "Texture", file, "", f'Type: "TextureVideoClip"\n{_properties(lines)}{names}')
        self.connect(texture, material, slot)
        if data is not None:
            content = f'Type: "Clip"\n{names}Content: ,\n"{base64.b64encode(data).decode()}"\n'
            self.connect(self._add("Video", "Video", file, "Clip", content), texture)
        return texture

    def connect(self, child, parent, slot=None):
        """Connect an object to another, or to one of its properties."""
        kind, where = ("OO", "") if slot is None else ("OP", f', "{slot}"')
        self._connections.append(f'C: "{kind}",{child},{parent}{where}\n')

    def __str__(self):
        settings = f"GlobalSettings:  {{\nVersion: 1000\n{_properties(self._settings)}}}\n"
        objects = f"Objects:  {{\n{''.join(self._objects)}}}\n"
        return f"{HEADER}{settings}{objects}Connections:  {{\n{''.join(self._connections)}}}\n"

    def _add(self, element, prefix, name, kind, content):
        number = next(self._numbers)
        self._objects.append(f'{element}: {number}, "{prefix}::{name}", "{kind}" {{\n{content}}}\n')
        return number


def int_property(name, value):
    return f'P: "{name}", "int", "Integer", "",{value}\n'


def number_property(name, value):
    return f'P: "{name}", "Number", "", "A",{value}\n'


def _vector_property(name, value, kind="Vector3D"):
    return f'P: "{name}", "{kind}", "", "A",{",".join(map(str, value))}\n'


def _properties(lines):
    return f"Properties70:  {{\n{''.join(lines)}}}\n"


def _array(name, values):
    return f"{name}: *{len(values)} {{\na: {','.join(map(str, values))}\n}}\n"


def _layer(element, number, name, values, mapping, title="", index=None, indices=()):
    flat = [float(component) if name != "Materials" else component for value in values for component in value]
    reference = "IndexToDirect" if index or name == "Materials" else "Direct"
    head = (
        f'Version: 101\nName: "{title}"\nMappingInformationType: "{mapping}"\nReferenceInformationType: "{reference}"\n'
    )
    more = _array(index, indices) if index else ""
    return f"{element}: {number} {{\n{head}{_array(name, flat)}{more}}}\n"
