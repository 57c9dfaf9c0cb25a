// Reads one map back: the depth at the centre of each map texel, nearest to either end of the axis.

#include "map_code.glsl"

layout(local_size_x = LOCAL_SIZE) in;

layout(r32ui, binding = 0) readonly uniform uimage2D nears;
layout(r32ui, binding = 1) readonly uniform uimage2D fars;
layout(std430, binding = 0) writeonly buffer Depths { vec2 depths[]; };  // NOTHING where no occluder is

uniform uint size;  // of the map's side, which begins at map texel 0

void main() {
    uint texel = gl_GlobalInvocationID.x;
    if (texel >= size * size) return;
    ivec2 at = ivec2(texel % size, texel / size);
    uint near = imageLoad(nears, at).r, far = imageLoad(fars, at).r;
    depths[texel] = vec2(near == 0u ? NOTHING : mapDecode(near).x, far == 0u ? NOTHING : -mapDecode(far).x);
}
