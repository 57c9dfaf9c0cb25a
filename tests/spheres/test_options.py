"""Options that contradict each other, or themselves, are refused."""

import pytest

from aoprecalc.errors import UsageError
from aoprecalc.options import SphereOptions


@pytest.mark.parametrize(
    ("chosen", "complaint"),
    [
        ({"method": "shadow", "radius": "cover"}, "radius is not for method shadow"),
        ({"method": "collision", "radius": "uniform"}, "radius is not for method collision"),
        ({"method": "shadow", "init": "kmeans++"}, "init is not for method shadow"),
        ({"method": "shadow", "max_iterations": 5}, "max_iterations is not for method shadow"),
        ({"levels": (8, 4)}, "levels is 8,4; expected ascending"),
        ({"levels": (4, 4)}, "levels is 4,4; expected ascending"),
        ({"levels": (2, 9, 3)}, "levels is 2,9,3; expected ascending"),
        ({"levels": (0, 3)}, "levels is 0,3; expected ascending"),
        ({"levels": (-2,)}, "levels is -2; expected ascending"),
        ({"levels": (3, 1_000_001)}, "levels is 3,1000001; expected ascending"),
        ({"levels": (2, 4), "tolerance": 0.1}, "levels and tolerance both say how many"),
        ({"levels": (2, 200), "samples": 100}, r"(spheres|levels) asks for 200 spheres from 100 samples"),
        ({"spheres": 200, "samples": 100}, r"(spheres|levels) asks for 200 spheres from 100 samples"),
        ({"tolerance": -0.1}, "tolerance is -0.1; expected a number from 0 to 1"),
        ({"tolerance": 1.5}, "tolerance is 1.5"),
        ({"tolerance": float("nan")}, "tolerance is nan"),
        ({"method": "best"}, "method is 'best'; expected one of lloyd, algebraic, shadow, collision"),
    ],
)
def test_refused(chosen, complaint):
    with pytest.raises(UsageError, match=f"^{complaint}".replace("+", r"\+")):
        SphereOptions(**chosen)


@pytest.mark.parametrize(
    "chosen",
    [
        {"method": "shadow"},
        {"method": "collision", "tolerance": 0.1},
        {"levels": (1,)},
        {"levels": (1, 2, 100)},
        {"levels": (2, 50), "samples": 50},  # `spheres` does not count then
        {"tolerance": 0, "samples": 10},
        {"tolerance": 1},
        {"method": "algebraic", "radius": "cover", "init": "kmeans++"},
    ],
)
def test_accepted(chosen):
    options = SphereOptions(**chosen)
    assert {name: getattr(options, name) for name in chosen} == chosen
