// Adds, for every texel, what it sees along the axes of one batch.
//
// A texel's point P is compared with one map texel, at whose centre an occluder lies at a known point Q of a known plane.
// P is hidden if both planes say so:
//   the receiver's   Q rises above the plane through P at right angles to the geometric normal g;
//   the occluder's   where the plane through Q passes P's place in the map it is nearer to the light than P.
// Of two faces that meet, the first is exact beside a ridge and the second beside a valley, whatever their slopes; a face
// never hides itself. So no bias has to be chosen: the tolerances are those of the arithmetic, of the map's code, and of
// the grid to which vertices are moved, by which an occluder may be off sideways.

#include "octahedral.glsl"
#include "map_code.glsl"

layout(local_size_x = LOCAL_SIZE) in;

// Per axis: map x, map y, depth; pitch x, pitch y, the end that leads down to a floor; first map texel of the tile. All zero for an axis that is none.
layout(std140, binding = 0) uniform Axes { vec4 rows[5 * AXES]; };
layout(std430, binding = 1) readonly buffer Points { uvec4 points[]; };  // bits of the position, packed shading normal
layout(std430, binding = 2) readonly buffer Faces { uint faces[]; };    // face under each texel, or NO_FACE
layout(std430, binding = 3) readonly buffer Normals { float face_normals[]; };
layout(std430, binding = 4) buffer Sums { vec2 sums[]; };               // visible weight, whole weight

layout(r32ui, binding = 0) readonly uniform uimage2D nears;  // an image's loads are cheaper than texelFetch on llvmpipe
layout(r32ui, binding = 1) readonly uniform uimage2D fars;

uniform uint texel_count;
uniform int most_turns;  // 4, but a loop of constant length is unrolled, and then all turns are taken by all

struct Receiver {
    vec4 point;
    vec3 n, g;
    vec2 sum;
};

// Adds what a receiver sees along one axis.
void look(inout Receiver at, int axis) {
    vec4 across = rows[axis], upward = rows[axis + 1], along = rows[axis + 2];
    vec2 pitch = rows[axis + 3].xy;
    float g_along = dot(at.g, along.xyz), n_along = dot(at.n, along.xyz);
    float weight = max(0.0, g_along > 0.0 ? n_along : g_along < 0.0 ? -n_along : 0.0);
    float towards = g_along > 0.0 ? 1.0 : -1.0;  // the end of the axis from which light comes

    vec2 map = vec2(dot(across, at.point), dot(upward, at.point));
    vec2 tile = rows[axis + 4].xy, cell = floor(map);
    float depth = dot(along, at.point);
    vec2 slope = vec2(dot(at.g, across.xyz), dot(at.g, upward.xyz)) * pitch;

    // Where the point lies before all that the map holds there, its own surface ends between it and the centre of the
    // map texel. Then the next texel on its side tells what there is.
    vec2 beyond = mix(vec2(-1.0), vec2(1.0), greaterThanEqual(map, cell + 0.5));
    bool hidden = false;
    for (int turn = 0; turn < most_turns; turn++) {
        vec2 read = cell + beyond * vec2(turn == 1 || turn == 2, turn == 1 || turn == 3);
        uint code;
        if (towards > 0.0) code = imageLoad(nears, ivec2(read + tile)).r;
        else code = imageLoad(fars, ivec2(read + tile)).r;
        vec3 occluder = mapDecode(code);
        vec2 aside = (read + 0.5 - map) * pitch;
        float before = occluder.x - towards * depth;
        float rise = dot(slope, aside) + abs(g_along) * before;
        float nearer = before - towards * dot(occluder.yz, aside);
        bool known = code != 0u && nearer > -length(pitch);
        hidden = known
            && rise > ROUNDING + 2.0 / GRID * dot(abs(slope), pitch)
            && nearer > ROUNDING + dot(slopeError(occluder.yz), abs(aside));
        if (known) break;
    }

    hidden = hidden || towards * rows[axis + 3].z > 0.0;
    at.sum += vec2(hidden ? 0.0 : weight, weight);
}

Receiver receiver(uint texel) {
    bool there = texel < texel_count && faces[texel] != NO_FACE;
    if (!there) return Receiver(vec4(0.0), vec3(0.0), vec3(0.0), vec2(0.0));  // sees nothing, with no weight
    uint face = 3u * faces[texel];
    return Receiver(
        vec4(uintBitsToFloat(points[texel].xyz), 1.0),
        unpackUnit(points[texel].w),
        vec3(face_normals[face], face_normals[face + 1u], face_normals[face + 2u]),
        sums[texel]
    );
}

void main() {
    // Two receivers an invocation share what is read of each axis: a fifth less time on llvmpipe (measured).
    uint texel = gl_WorkGroupID.x * 2u * LOCAL_SIZE + gl_LocalInvocationID.x;
    Receiver one = receiver(texel), other = receiver(texel + LOCAL_SIZE);
    // One axis after the other, so that the sums do not depend on how axes are batched. EACH_AXIS calls look() for all
    // of a batch by constants: what has a variable index llvmpipe reads lane by lane (measured: a fifth of the time).
    EACH_AXIS
    if (texel < texel_count) sums[texel] = one.sum;
    if (texel + LOCAL_SIZE < texel_count) sums[texel + LOCAL_SIZE] = other.sum;
}
