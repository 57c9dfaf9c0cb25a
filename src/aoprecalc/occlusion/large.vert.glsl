// Large occluders seen along several axes at once: one instance an axis.

#include "near_far.glsl"

uniform vec2 target_size;  // map texels

in vec3 in_position;
out float depth;
flat out vec2 pitch;  // sides of a map texel

void main() {
    int axis = 5 * gl_InstanceID;
    vec3 corner = project(in_position, axis);
    depth = corner.z;
    pitch = rows[axis + 3].xy;
    gl_Position = vec4((corner.xy + rows[axis + 4].xy) / target_size * 2.0 - 1.0, 0.0, 1.0);
}
