"""HTML that notebooks show for a result: pictures and drawings side by side, and a line of figures below.

Colours of text are those of the notebook, light or dark.
"""

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from math import cos, radians, sin

Point = Sequence[float]

_TURN, _RISE = radians(24.0), radians(20.0)  # of the view: from the front, to the right and from above
_NEAR, _FAR = (205, 217, 230), (74, 96, 122)  # colours of spheres
_WIDTH = 360  # pixels of a drawing


def figure(drawings: Sequence[str], line: str) -> str:
    """Return drawings side by side, each HTML, and a line of text below."""
    shown = "".join(drawings)
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:12px;align-items:center">'
        f'{shown}</div><div style="margin-top:6px">{escape(line)}</div>'
    )


def image(png: bytes, text: str, height: int) -> str:
    """Return a picture; `text` says what it shows."""
    data = b64encode(png).decode()
    style = f"height:{height}px;max-width:100%;object-fit:contain"
    return f'<img src="data:image/png;base64,{data}" alt="{escape(text)}" style="{style}"/>'


def spheres_drawing(centers: Sequence[Point], radii: Sequence[float], text: str) -> str:
    """Return spheres as an SVG of circles, seen from the front and somewhat from above, y upwards; the nearest on top.

    centers, radii   finite numbers, at least one sphere
    """
    circles = sorted((*_seen(center), radius) for center, radius in zip(centers, radii, strict=True))
    left, right = (extreme(x + side * r for _, x, _, r in circles) for extreme, side in ((min, -1), (max, 1)))
    top, bottom = (extreme(y + side * r for _, _, y, r in circles) for extreme, side in ((min, -1), (max, 1)))
    scale = _WIDTH / (max(right - left, bottom - top) or 1.0)
    width, height = (max(extent * scale, 1) for extent in (right - left, bottom - top))
    far, near = circles[0][0], circles[-1][0]
    shapes = []
    for depth, x, y, radius in circles:
        share = (depth - far) / (near - far) if near > far else 1.0
        red, green, blue = (round(low + share * (high - low)) for low, high in zip(_FAR, _NEAR, strict=True))
        place = f'cx="{(x - left) * scale:.1f}" cy="{(y - top) * scale:.1f}" r="{max(radius * scale, 0.5):.1f}"'
        shapes.append(f'<circle {place} fill="rgb({red},{green},{blue})"/>')
    box = f'width="{width:.0f}" height="{height:.0f}" viewBox="-1 -1 {width + 2:.1f} {height + 2:.1f}"'
    group = f'<g stroke="#2b3a4c" stroke-width="0.8">{"".join(shapes)}</g>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} style="max-width:100%;height:auto" role="img">'
        f"<title>{escape(text)}</title>{group}</svg>"
    )


def _seen(point: Point) -> tuple[float, float, float]:
    """Return how near a point is, and where it is to the right and downwards."""
    x, y, z = map(float, point)
    right, forward = x * cos(_TURN) - z * sin(_TURN), x * sin(_TURN) + z * cos(_TURN)
    return forward * cos(_RISE) + y * sin(_RISE), right, -(y * cos(_RISE) - forward * sin(_RISE))
