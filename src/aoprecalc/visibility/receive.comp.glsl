// Interpolates the position and the shading normal of each sample (a face and barycentric weights): the receiver.

#include "octahedral.glsl"

layout(local_size_x = LOCAL_SIZE) in;

layout(std430, binding = 0) readonly buffer Positions { float positions[]; };       // v * 3
layout(std430, binding = 1) readonly buffer Corners { uint corners[]; };            // f * 3
layout(std430, binding = 2) readonly buffer CornerNormals { float normals[]; };     // f * 9
layout(std430, binding = 3) readonly buffer FaceNormals { float face_normals[]; };  // f * 3
layout(std430, binding = 4) readonly buffer Faces { uint faces[]; };                // or NO_FACE
layout(std430, binding = 5) readonly buffer Weights { vec2 weights[]; };            // of the second and third corner
layout(std430, binding = 6) writeonly buffer Points { uvec4 points[]; };
layout(std430, binding = 7) writeonly buffer Sums { float sums[]; };        // COLUMNS for each

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
    for (uint column = 0u; column < COLUMNS; column++) sums[COLUMNS * texel + column] = 0.0;
    if (faces[texel] == NO_FACE) return;

    uint corner = 3u * faces[texel];
    vec2 weight = weights[texel];
    float rest = 1.0 - weight.x - weight.y;
    vec3 p = rest * position(corner) + weight.x * position(corner + 1u) + weight.y * position(corner + 2u);
    vec3 n = rest * normal(corner) + weight.x * normal(corner + 1u) + weight.y * normal(corner + 2u);
    vec3 g = vec3(face_normals[corner], face_normals[corner + 1u], face_normals[corner + 2u]);
    if (dot(n, g) <= 0.0) n = g;  // a shading normal on the other side of the surface is not used
    points[texel] = uvec4(floatBitsToUint(p), packUnit(n));
}
