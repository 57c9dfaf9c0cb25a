"""Sphere sets as the YAML in which cuRobo keeps the collision spheres of a robot's links."""

import json

from aoprecalc.model import SphereSet


def curobo_yaml(spheres: SphereSet, link: str) -> str:
    """Lay out all spheres as those of one link, of a printable name."""
    # Quoted, because a bare `12` or `no` is not a string in YAML; a printable JSON string in its own letters is YAML.
    lines = ["collision_spheres:", f"  {json.dumps(link, ensure_ascii=False)}:"]
    for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True):
        lines.append(f"    - center: [{', '.join(map(_number, center))}]")
        lines.append(f"      radius: {_number(radius)}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """Return the digits that give the same float64 back; 1e-07 with a point, without which YAML 1.1 takes a string."""
    text = repr(value)
    return text if "." in text else text.replace("e", ".0e")
