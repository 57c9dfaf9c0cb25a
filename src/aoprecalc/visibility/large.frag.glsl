// Blended with MAX: the first target keeps the occluder nearest to the axis' positive end, the second the one nearest to
// its negative end. There depths count the other way, and slopes as in the first.

#include "map_code.glsl"

in float depth;
flat in uint slopes;
layout(location = 0) out float near;
layout(location = 1) out float far;

void main() {
    near = FRONTS_ONLY && gl_FrontFacing ? 0.0 : uintBitsToFloat(mapCode(depth, slopes));
    far = FRONTS_ONLY && !gl_FrontFacing ? 0.0 : uintBitsToFloat(mapCode(-depth, slopes));
}
