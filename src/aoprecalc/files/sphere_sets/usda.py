"""Sphere sets as USD text: sphere prims under one transform."""

from aoprecalc.model import SphereSet

# glTF's and most meshes' y is up; what a unit of the mesh is in metres nobody knows, so that one is one.
_HEAD = """\
#usda 1.0
(
    defaultPrim = "{name}"
    metersPerUnit = 1
    upAxis = "Y"
)

def Xform "{name}"
{{
"""

# The extent has to be there: without it a sphere counts as one of radius 1 when boxes are computed.
_SPHERE = """\
    def Sphere "sphere_{number}"
    {{
        float3[] extent = [({low!r}, {low!r}, {low!r}), ({radius!r}, {radius!r}, {radius!r})]
        double radius = {radius!r}
        double3 xformOp:translate = ({x!r}, {y!r}, {z!r})
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
"""


def usda_stage(spheres: SphereSet, name: str) -> str:
    """Lay out a stage whose default prim has the given name, an identifier, and a sphere prim for each sphere."""
    prims = [
        _SPHERE.format(number=number, x=x, y=y, z=z, radius=radius, low=-radius)
        for number, ((x, y, z), radius) in enumerate(zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True))
    ]
    return f"{_HEAD.format(name=name)}{''.join(prims)}}}\n"
