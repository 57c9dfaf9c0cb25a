// Occluders seen along several axes at once: one instance an axis, one tile of the target an instance.

layout(std140, binding = 0) uniform Axes { vec4 rows[5 * AXES]; };

uniform vec2 target_size;  // map texels

in vec3 in_position;
out float depth;
flat out vec2 pitch;  // sides of a map texel

void main() {
    int axis = 5 * gl_InstanceID;
    vec4 point = vec4(in_position, 1.0);
    vec2 map = vec2(dot(rows[axis], point), dot(rows[axis + 1], point));
    map = round(map * GRID) / GRID + rows[axis + 4].xy;
    depth = dot(rows[axis + 2], point);
    pitch = rows[axis + 3].xy;
    gl_Position = vec4(map / target_size * 2.0 - 1.0, 0.0, 1.0);
}
