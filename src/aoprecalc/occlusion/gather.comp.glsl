// Adds, for every texel, what it sees along the axes of one batch.
//
// A texel is compared with one map texel, at whose centre an occluder lies at a known point Q. The texel's point P is
// hidden if Q rises above the receiver's plane, through P at right angles to the geometric normal g, by more than
// a tolerance: g . (Q - P) > tolerance. On a plane the left side is 0 whatever the slope, so the tolerance has only to
// cover rounding and surfaces that bend within a map texel; near_far.py has its constants.

#include "octahedral.glsl"

const float SNAP = 1.0 / 128.0;  // map texels by which rounding of vertices may move an occluder sideways

layout(local_size_x = LOCAL_SIZE) in;

// Per axis: map x, map y, depth; (pitch x, pitch y, tolerance, tolerance per distance); first map texel of the tile.
// A uniform block, not a storage buffer: llvmpipe reads the latter lane by lane.
layout(std140, binding = 0) uniform Axes { vec4 rows[5 * MOST_AXES]; };
layout(std430, binding = 1) readonly buffer Points { uvec4 points[]; };  // bits of the position, packed shading normal
layout(std430, binding = 2) readonly buffer Faces { uint faces[]; };    // face under each texel, or NO_FACE
layout(std430, binding = 3) readonly buffer Normals { float face_normals[]; };
layout(std430, binding = 4) buffer Sums { vec2 sums[]; };               // visible weight, whole weight

uniform sampler2D maps;
uniform int axis_count;
uniform uint texel_count;

void main() {
    uint texel = gl_GlobalInvocationID.x;
    if (texel >= texel_count || faces[texel] == NO_FACE) return;

    vec4 point = vec4(uintBitsToFloat(points[texel].xyz), 1.0);
    vec3 n = unpackUnit(points[texel].w);
    uint face = 3u * faces[texel];
    vec3 g = vec3(face_normals[face], face_normals[face + 1u], face_normals[face + 2u]);

    // One axis after the other, so that the sums do not depend on how axes are batched.
    vec2 sum = sums[texel];
    for (int axis = 0; axis < 5 * axis_count; axis += 5) {
        vec4 across = rows[axis], upward = rows[axis + 1], along = rows[axis + 2], scale = rows[axis + 3];
        float g_along = dot(g, along.xyz), n_along = dot(n, along.xyz);
        float weight = max(0.0, g_along > 0.0 ? n_along : g_along < 0.0 ? -n_along : 0.0);

        vec2 map = vec2(dot(across, point), dot(upward, point));
        vec2 cell = floor(map);
        vec2 ends = texelFetch(maps, ivec2(cell + rows[axis + 4].xy), 0).rg;
        float depth = g_along > 0.0 ? ends.x : -ends.y;

        vec2 aside = (cell + 0.5 - map) * scale.xy;
        vec2 slope = vec2(dot(g, across.xyz), dot(g, upward.xyz)) * scale.xy;
        float rise = dot(slope, aside) + g_along * (depth - dot(along, point));
        float tolerance = scale.z + dot(abs(slope), scale.xy) * SNAP + scale.w * abs(g_along) * length(aside);

        sum += vec2(rise <= tolerance ? weight : 0.0, weight);
    }
    sums[texel] = sum;
}
