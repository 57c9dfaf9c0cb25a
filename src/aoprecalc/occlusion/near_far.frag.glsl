// Blended with MAX: the first channel keeps the occluder nearest to the axis' positive end, the second to its negative
// end, where depths count the other way and slopes as in the first.

#include "map_code.glsl"

in float depth;
flat in vec2 pitch;
out vec2 ends;

void main() {
    vec2 slope = vec2(dFdx(depth), dFdy(depth)) / pitch;
    ends = vec2(mapCode(depth, slope), mapCode(-depth, slope));
}
