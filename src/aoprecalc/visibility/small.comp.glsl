// Small occluders along one axis: an invocation tests the few map texels that its triangle may cover. The rasterizer of
// llvmpipe sets up triangles one by one and takes twice as long for the smallest (measured: 273,000 in 26 ms, here 14).
// (Idea: B. Karis, R. Stubbe, G. Wihlidal, "A Deep Dive into Nanite Virtualized Geometry", 2021.)

#include "map_code.glsl"
#include "projection.glsl"

layout(local_size_x = LOCAL_SIZE) in;

layout(std430, binding = 0) readonly buffer Corners { float corners[]; };  // t * 9
layout(r32ui, binding = 0) uniform uimage2D nears;
layout(r32ui, binding = 1) uniform uimage2D fars;

uniform int axis;  // 5 times its index
uniform uint triangle_count;
uniform float last_texel;  // of a map, along either side

vec3 corner(uint at) {
    return project(vec3(corners[at], corners[at + 1u], corners[at + 2u]), axis);
}

void main() {
    uint triangle = gl_GlobalInvocationID.x;
    if (triangle >= triangle_count) return;

    vec3 a = corner(9u * triangle), b = corner(9u * triangle + 3u), c = corner(9u * triangle + 6u);
    // Multiples of 1 / GRID within a few map texels: their products are exact.
    vec2 ab = b.xy - a.xy, ac = c.xy - a.xy;
    float area = ab.x * ac.y - ab.y * ac.x;
    if (area == 0.0) return;

    vec2 rise = vec2(b.z, c.z) - a.z;
    vec2 slope = vec2(rise.x * ac.y - rise.y * ab.y, rise.y * ab.x - rise.x * ac.x) / area;  // per map texel
    uint slopes = slopesCode(slope / rows[axis + 3].xy);
    float min_depth = min(a.z, min(b.z, c.z)), max_depth = max(a.z, max(b.z, c.z));

    vec2 first = ceil(min(a.xy, min(b.xy, c.xy)) - 0.5), last = floor(max(a.xy, max(b.xy, c.xy)) - 0.5);
    first = max(first, 0.0);
    last = min(last, last_texel);
    if (first.x > last.x) return;
    vec2 cell = first, toward_b = vec2(ac.y, -ac.x) * sign(area), toward_c = vec2(-ab.y, ab.x) * sign(area);
    while (cell.y <= last.y) {
        // Go on to the next covered map texel; the costly part below runs only there.
        vec2 at;
        bool covered = false;
        while (cell.y <= last.y && !covered) {
            at = cell + 0.5 - a.xy;
            // Barycentric weights of b and c, times the area; edges are inclusive, so that neighbours leave no gap.
            float of_b = dot(at, toward_b), of_c = dot(at, toward_c);
            covered = min(of_b, of_c) >= 0.0 && of_b + of_c <= abs(area);
            cell.x += 1.0;
            if (cell.x > last.x) cell = vec2(first.x, cell.y + 1.0);
        }
        if (covered) {
            float depth = clamp(a.z + dot(slope, at), min_depth, max_depth);
            ivec2 texel = ivec2(at + a.xy + rows[axis + 4].xy);
            // What is clockwise in the map faces those whom light from the positive end would reach.
            if (!FRONTS_ONLY || area < 0.0) imageAtomicMax(nears, texel, mapCode(depth, slopes));
            if (!FRONTS_ONLY || area > 0.0) imageAtomicMax(fars, texel, mapCode(-depth, slopes));
        }
    }
}
