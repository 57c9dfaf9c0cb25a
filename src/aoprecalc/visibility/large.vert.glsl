// Large occluders, rasterised into the maps of several axes at once: one instance for each axis. Those that may leave the
// tile of their map are rasterised into one map at a time, to which the viewport cuts them.

#include "map_code.glsl"
#include "projection.glsl"

uniform vec2 viewport_size;  // map texels
uniform int first_axis;
uniform float has_tiles;  // 1 where the viewport is the whole target, 0 where it is a tile

in vec3 in_position;
in vec3 in_normal;  // of the plane of the triangle, not zero
out float depth;
flat out uint slopes;  // of the plane, hence per vertex: fragments save a third of their time (measured)

void main() {
    int axis = 5 * (first_axis + gl_InstanceID);
    vec3 corner = project(in_position, axis);
    depth = corner.z;
    vec2 aside = vec2(dot(in_normal, rows[axis].xyz), dot(in_normal, rows[axis + 1].xyz)) * rows[axis + 3].xy;
    float along = dot(in_normal, rows[axis + 2].xyz);
    slopes = slopesCode(-aside / (abs(along) < 1e-9 ? 1e-9 : along));
    gl_Position = vec4((corner.xy + has_tiles * rows[axis + 4].xy) / viewport_size * 2.0 - 1.0, 0.0, 1.0);
}
