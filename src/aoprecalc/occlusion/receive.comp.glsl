// Turns what the raster found under each covered texel into a point that receives light.

#include "octahedral.glsl"

layout(local_size_x = LOCAL_SIZE) in;

layout(std430, binding = 0) readonly buffer Positions { float positions[]; };       // v * 3
layout(std430, binding = 1) readonly buffer Corners { uint corners[]; };            // f * 3
layout(std430, binding = 2) readonly buffer CornerNormals { float normals[]; };     // f * 9
layout(std430, binding = 3) readonly buffer FaceNormals { float face_normals[]; };  // f * 3
layout(std430, binding = 4) readonly buffer Index { uint index[]; };                // covered texels, in the whole picture
layout(std430, binding = 5) writeonly buffer Points { uvec4 points[]; };
layout(std430, binding = 6) writeonly buffer Faces { uint faces[]; };
layout(std430, binding = 7) writeonly buffer Sums { vec2 sums[]; };

uniform sampler2D surface;
uniform uint width;
uniform uint first_row;
uniform uint texel_count;

vec3 position(uint corner) {
    uint at = 3u * corners[corner];
    return vec3(positions[at], positions[at + 1u], positions[at + 2u]);
}

vec3 normal(uint corner) {
    return vec3(normals[3u * corner], normals[3u * corner + 1u], normals[3u * corner + 2u]);
}

void main() {
    uint texel = gl_GlobalInvocationID.x;
    if (texel >= texel_count) return;
    sums[texel] = vec2(0.0);

    uint place = index[texel];
    vec4 found = texelFetch(surface, ivec2(place % width, place / width - first_row), 0);
    if (found.x == 0.0) {
        faces[texel] = NO_FACE;
        return;
    }
    uint face = uint(found.x) - 1u;
    vec2 weights = max(found.yz, 0.0);
    weights /= max(1.0, weights.x + weights.y);
    float rest = 1.0 - weights.x - weights.y;

    uint corner = 3u * face;
    vec3 p = rest * position(corner) + weights.x * position(corner + 1u) + weights.y * position(corner + 2u);
    vec3 n = rest * normal(corner) + weights.x * normal(corner + 1u) + weights.y * normal(corner + 2u);
    vec3 g = vec3(face_normals[corner], face_normals[corner + 1u], face_normals[corner + 2u]);
    if (dot(n, g) <= 0.0) n = g;  // a shading normal that leaves the surface's own side says nothing
    faces[texel] = face;
    points[texel] = uvec4(floatBitsToUint(p), packUnit(n));
}
