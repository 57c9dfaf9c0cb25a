"""COLLADA, made by code."""

POINTS = [(0, 0, 0), (4, 0, 0), (4, 4, 0), (2, 1, 0), (0, 4, 0)]  # of a concave polygon
UVS = [(0, 0), (1, 0), (1, 1), (0.5, 0.25), (0, 1)]


def source(name, rows):
    size = len(rows[0])
    numbers = " ".join(str(float(number)) for row in rows for number in row)
    params = "".join(f'<param name="{letter}" type="float"/>' for letter in "XYZ"[:size])
    return f"""<source id="{name}"><float_array id="{name}-a" count="{size * len(rows)}">{numbers}</float_array>
        <technique_common><accessor source="#{name}-a" count="{len(rows)}" stride="{size}">{params}</accessor>
        </technique_common></source>"""


def document(diffuse="", more="", matrix="", nodes=None, asset="", libraries="", sets=(UVS,)):
    """A concave polygon with a material of the given elements."""
    inputs = "".join(f'<input semantic="TEXCOORD" source="#uv{n}" offset="2" set="{n}"/>' for n in range(len(sets)))
    corners = " ".join(f"{n} 0 {n}" for n in range(5))
    placed = f"""<node id="n" name="sheet"><matrix>{matrix or "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"}</matrix>
        <instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m">
        <bind_vertex_input semantic="CHANNEL" input_semantic="TEXCOORD" input_set="{len(sets) - 1}"/>
        </instance_material></technique_common></bind_material></instance_geometry></node>"""
    images = "".join(f'<image id="{name}"><init_from>{name}.png</init_from></image>' for name in ("color", "holes"))
    samplers = "".join(
        f"""<newparam sid="{name}-f"><surface type="2D"><init_from>{name}</init_from></surface></newparam>
        <newparam sid="{name}-s"><sampler2D><source>{name}-f</source></sampler2D></newparam>"""
        for name in ("color", "holes")
    )
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
        <asset>{asset}</asset>{libraries}<library_images>{images}</library_images><library_effects><effect id="e">
        <profile_COMMON>{samplers}<technique sid="t"><phong>{diffuse}</phong>{more}</technique></profile_COMMON>
        </effect></library_effects><library_materials><material id="m" name="paint"><instance_effect url="#e"/>
        </material></library_materials><library_geometries><geometry id="g" name="shape"><mesh>
        {source("p", POINTS)}{source("no", [(0, 0, 1)])}{"".join(source(f"uv{n}", uvs) for n, uvs in enumerate(sets))}
        <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
        <polylist material="s" count="1"><input semantic="VERTEX" source="#v" offset="0"/>
        <input semantic="NORMAL" source="#no" offset="1"/>{inputs}<vcount>5</vcount><p>{corners}</p></polylist>
        </mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="w">{nodes or placed}
        </visual_scene></library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def colored(red, green, blue, alpha=1.0):
    return f"<color>{red} {green} {blue} {alpha}</color>"


def textured(name):
    return f'<texture texture="{name}-s" texcoord="CHANNEL"/>'
