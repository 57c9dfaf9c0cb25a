"""What a batch works on: an asset, and what is to be made of it."""

from dataclasses import dataclass, replace
from pathlib import Path

from aoprecalc.options import BakeOptions, SphereOptions


@dataclass(frozen=True)
class Order:
    """What is made of one asset: a texture, spheres, or both.

    bake      how the texture is baked; None: no texture
    spheres   how spheres are fitted; None: none
    texture   extension of the texture
    mesh      extension of the mesh that goes with it; empty: as `aoprecalc bake` chooses
    verify    measure the texture against ray tracing, for the report
    set       extension of the sphere set
    """

    bake: BakeOptions | None = None
    spheres: SphereOptions | None = None
    texture: str = ".png"
    mesh: str = ""
    verify: bool = False
    set: str = ".json"

    def with_threads(self, threads: int) -> "Order":
        """Return the same with this many threads where it says nothing about them."""
        if self.bake is None or self.bake.threads:
            return self
        return replace(self, bake=replace(self.bake, threads=threads))


@dataclass(frozen=True)
class Asset:
    """One mesh of a batch.

    name    its folder and stem below the output folder, such as props/rock, with forward slashes; no other's
    mesh    its file, as the pattern found it
    order   what is made of it
    """

    name: str
    mesh: Path
    order: Order

    @property
    def folder(self) -> str:
        """Its folder below the output folder; empty for that itself."""
        return self.name.rpartition("/")[0]

    @property
    def stem(self) -> str:
        """What its files' names begin with."""
        return self.name.rpartition("/")[2]
