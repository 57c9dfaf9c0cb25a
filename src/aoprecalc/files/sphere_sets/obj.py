"""Sphere sets as Wavefront OBJ: an icosphere for each sphere, for programs that know only triangles."""

from aoprecalc.files.sphere_sets.ball import unit_ball
from aoprecalc.model import SphereSet


def spheres_obj(spheres: SphereSet) -> str:
    """Lay out an object `sphere_<number>` for each sphere, from 0; they share one set of normals.

    A sphere of radius 0 is an object too, all of whose triangles lie in its centre.
    """
    points, triangles = unit_ball()
    lines = ["vn {!r} {!r} {!r}".format(*row) for row in points.tolist()]
    for number, (center, radius) in enumerate(zip(spheres.centers, spheres.radii, strict=True)):
        lines.append(f"o sphere_{number}")
        lines += ["v {!r} {!r} {!r}".format(*row) for row in (center + radius * points).tolist()]
        first = 1 + number * len(points)
        lines += [f"f {a + first}//{a + 1} {b + first}//{b + 1} {c + first}//{c + 1}" for a, b, c in triangles.tolist()]
    return "\n".join(lines) + "\n"
