// Large occluders, rasterised into the maps of several axes at once: one instance for each axis.

#include "map_code.glsl"
#include "projection.glsl"

uniform vec2 target_size;  // map texels

in vec3 in_position;
in vec3 in_normal;  // of the plane of the triangle, not zero
out float depth;
flat out uint slopes;  // of the plane, hence per vertex: fragments save a third of their time (measured)

void main() {
    int axis = 5 * gl_InstanceID;
    vec3 corner = project(in_position, axis);
    depth = corner.z;
    vec2 aside = vec2(dot(in_normal, rows[axis].xyz), dot(in_normal, rows[axis + 1].xyz)) * rows[axis + 3].xy;
    float along = dot(in_normal, rows[axis + 2].xyz);
    slopes = slopesCode(-aside / (abs(along) < 1e-9 ? 1e-9 : along));
    gl_Position = vec4((corner.xy + rows[axis + 4].xy) / target_size * 2.0 - 1.0, 0.0, 1.0);
}
