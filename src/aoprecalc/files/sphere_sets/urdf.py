"""Sphere sets as URDF: a robot of one link that collides as the spheres do, and is seen as them."""

from xml.etree import ElementTree

import numpy as np

from aoprecalc.files.sphere_sets.ball import COLOR
from aoprecalc.model import SphereSet


def urdf_robot(spheres: SphereSet, name: str) -> str:
    """Lay out a robot and its link, both of the printable name, with a collision and a visual for each sphere.

    They are called `sphere_<number>`, from 0. Spheres of radius 0 are left out: they are no bodies, and trimesh, which
    Python readers of URDF build on, makes NaN of them.
    """
    robot = ElementTree.Element("robot", name=name)
    material = ElementTree.SubElement(robot, "material", name="spheres")
    ElementTree.SubElement(material, "color", rgba=_numbers(*COLOR))
    link = ElementTree.SubElement(robot, "link", name=name)
    for kind in ("collision", "visual"):
        for number in np.flatnonzero(spheres.radii).tolist():
            center, radius = spheres.centers[number].tolist(), float(spheres.radii[number])
            element = ElementTree.SubElement(link, kind, name=f"sphere_{number}")
            ElementTree.SubElement(element, "origin", xyz=_numbers(*center), rpy="0 0 0")
            geometry = ElementTree.SubElement(element, "geometry")
            ElementTree.SubElement(geometry, "sphere", radius=_numbers(radius))
            if kind == "visual":
                ElementTree.SubElement(element, "material", name="spheres")
    ElementTree.indent(robot)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _numbers(*values: float) -> str:
    return " ".join(map(repr, values))
