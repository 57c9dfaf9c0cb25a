"""The values that travel through a job, each an immutable record over NumPy arrays.

    file | arrays -> Scene -> Atlas -> Texels -> visibility sums -> Texture -> files     (bake)
    file | arrays -> Scene -> samples -> SphereSet -> files                              (spheres)

Normals and UVs, which differ along seams, are stored at the corners of faces, never at vertices, so that no step has to
split or weld anything. Sizes in the docstrings: v distinct positions, f faces, k texels.
"""

from aoprecalc.types.results import (
    CONFIDENCE,
    Atlas,
    Baked,
    BaseColor,
    Certificate,
    DarkPart,
    DarkTexels,
    Padding,
    SizeEstimates,
    SphereSet,
    Texels,
    Texture,
    TexturedMesh,
    UvCheck,
)
from aoprecalc.types.scene import (
    REVERSED_WINDING,
    AlphaMask,
    BoolArray,
    Float32Array,
    Float64Array,
    Ground,
    Int32Array,
    Int64Array,
    Material,
    Part,
    Picture,
    Scene,
    Surroundings,
    UInt8Array,
    Wrap,
)

__all__ = [
    "CONFIDENCE",
    "REVERSED_WINDING",
    "AlphaMask",
    "Atlas",
    "Baked",
    "BaseColor",
    "BoolArray",
    "Certificate",
    "DarkPart",
    "DarkTexels",
    "Float32Array",
    "Float64Array",
    "Ground",
    "Int32Array",
    "Int64Array",
    "Material",
    "Padding",
    "Part",
    "Picture",
    "Scene",
    "SizeEstimates",
    "SphereSet",
    "Surroundings",
    "Texels",
    "Texture",
    "TexturedMesh",
    "UInt8Array",
    "UvCheck",
    "Wrap",
]
