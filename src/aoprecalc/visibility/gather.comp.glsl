// Adds the visibility of every texel along the axes of one batch (Précalcul, section 1.1.2 (b)).
//
// The texel's surface point P is compared with one map texel, at whose centre an occluder has a known point Q and plane.
// P is hidden if both planes say so:
//   the receiver's   Q lies above the plane through P at right angles to the geometric normal g;
//   the occluder's   the plane through Q, at P's position in the map, is nearer to the light than P.
// Where two faces meet, the first test is exact at a convex edge and the second at a concave edge, at any slope; a face
// never hides itself. So there is no bias to choose: the tolerances are those of the arithmetic, of the map's encoding,
// and of the grid to which vertices are snapped, by which an occluder may be off sideways.

#include "octahedral.glsl"
#include "map_code.glsl"

layout(local_size_x = LOCAL_SIZE) in;

// Per axis: map x, map y, depth; pitch x, pitch y, the end that points below the ground; first map texel of the tile,
// radiance of the sky from the positive and the negative end. All zero beyond the last axis of a batch.
layout(std140, binding = 0) uniform Axes { vec4 rows[5 * AXES]; };
layout(std430, binding = 1) readonly buffer Points { uvec4 points[]; };  // bits of the position, packed shading normal
layout(std430, binding = 2) readonly buffer Faces { uint faces[]; };    // face under each texel, or NO_FACE
layout(std430, binding = 3) readonly buffer Normals { float face_normals[]; };
// COLUMNS for each texel: visible weight, total weight; where there are 5, the sum of visible weight times direction.
layout(std430, binding = 4) buffer Sums { float sums[]; };

layout(r32ui, binding = 0) readonly uniform uimage2D nears;  // on llvmpipe imageLoad is cheaper than texelFetch
layout(r32ui, binding = 1) readonly uniform uimage2D fars;

uniform uint texel_count;
uniform int max_taps;  // 4: with a constant the loop is unrolled, and then all invocations read all four

struct Receiver {
    vec4 point;
    vec3 n, g;
    vec2 sum;
    vec3 vector;
};

// Adds the visibility of a receiver along one axis, in the one of its two directions that the receiver faces.
void addAxis(inout Receiver at, int axis) {
    vec4 across = rows[axis], upward = rows[axis + 1], along = rows[axis + 2];
    vec2 pitch = rows[axis + 3].xy;
    float g_along = dot(at.g, along.xyz), n_along = dot(at.n, along.xyz);
    float cosine = g_along > 0.0 ? n_along : g_along < 0.0 ? -n_along : 0.0;
    float weight = cosine > 0.0 && cosine >= MIN_COSINE ? WEIGHT : 0.0;
    float towards = g_along > 0.0 ? 1.0 : -1.0;  // the end of the axis from which light comes
    if (SKY) weight *= towards > 0.0 ? rows[axis + 4].z : rows[axis + 4].w;

    vec2 map = vec2(dot(across, at.point), dot(upward, at.point));
    vec2 tile = rows[axis + 4].xy, cell = floor(map);
    float depth = dot(along, at.point);
    vec2 slope = vec2(dot(at.g, across.xyz), dot(at.g, upward.xyz)) * pitch;

    // If the point is nearer to the light than anything in its map texel, its own surface ends between it and the texel's
    // centre. Then the neighbours on its side are read.
    vec2 beyond = mix(vec2(-1.0), vec2(1.0), greaterThanEqual(map, cell + 0.5));
    bool hidden = false;
    for (int tap = 0; tap < max_taps; tap++) {
        vec2 read = cell + beyond * vec2(tap == 1 || tap == 2, tap == 1 || tap == 3);
        uint code;
        if (towards > 0.0) code = imageLoad(nears, ivec2(read + tile)).r;
        else code = imageLoad(fars, ivec2(read + tile)).r;
        vec3 occluder = mapDecode(code);
        vec2 aside = (read + 0.5 - map) * pitch;                    // from P to Q across the axis
        float before = occluder.x - towards * depth;                // from P to Q along the axis, positive towards the light
        float rise = dot(slope, aside) + abs(g_along) * before;     // height of Q above the receiver's plane
        float nearer = before - towards * dot(occluder.yz, aside);  // from P along the axis to the occluder's plane
        bool known = code != 0u && nearer > -length(pitch);
        // Without the receiver's own surface in the map, a neighbour counts only where it comes down to P at a concave edge:
        // within half a map texel. Else the edge of every occluder would hide half a texel more.
        if (FRONTS_ONLY && tap > 0) known = known && nearer < 0.5 * (length(pitch) + dot(abs(occluder.yz), pitch));
        hidden = known
            && rise > ROUNDING + 2.0 / GRID * dot(abs(slope), pitch)
            && nearer > ROUNDING + dot(slopeError(occluder.yz), abs(aside));
        if (known) break;
    }

    hidden = hidden || towards * rows[axis + 3].z > 0.0;
    float visible = hidden ? 0.0 : weight;
    at.sum += vec2(visible, weight);
    if (COLUMNS == 5u) at.vector += visible * towards * along.xyz;
}

Receiver receiver(uint texel) {
    bool has_face = texel < texel_count && faces[texel] != NO_FACE;
    if (!has_face) return Receiver(vec4(0.0), vec3(0.0), vec3(0.0), vec2(0.0), vec3(0.0));  // no normals: no weight
    uint face = 3u * faces[texel], first = COLUMNS * texel;
    return Receiver(
        vec4(uintBitsToFloat(points[texel].xyz), 1.0),
        unpackUnit(points[texel].w),
        vec3(face_normals[face], face_normals[face + 1u], face_normals[face + 2u]),
        vec2(sums[first], sums[first + 1u]),
        COLUMNS == 5u ? vec3(sums[first + 2u], sums[first + 3u], sums[first + 4u]) : vec3(0.0)
    );
}

void store(Receiver at, uint texel) {
    if (texel >= texel_count) return;
    uint first = COLUMNS * texel;
    sums[first] = at.sum.x;
    sums[first + 1u] = at.sum.y;
    if (COLUMNS < 5u) return;
    sums[first + 2u] = at.vector.x;
    sums[first + 3u] = at.vector.y;
    sums[first + 4u] = at.vector.z;
}

void main() {
    // Two receivers an invocation share the loads of each axis: a fifth less time on llvmpipe (measured).
    uint texel = gl_WorkGroupID.x * 2u * LOCAL_SIZE + gl_LocalInvocationID.x;
    Receiver one = receiver(texel), other = receiver(texel + LOCAL_SIZE);
    // One axis after the other, so that the sums do not depend on how axes are batched. EACH_AXIS calls addAxis() for
    // every axis of a batch with constants: llvmpipe loads variable indices lane by lane (measured: a fifth of the time).
    EACH_AXIS
    store(one, texel);
    store(other, texel + LOCAL_SIZE);
}
