// Projection of corners into the maps of a batch of axes, one tile for each.

layout(std140, binding = 0) uniform Axes { vec4 rows[5 * AXES]; };

// Position of a corner in its map, snapped to the grid of rasterizers, and its depth; bit-equal in all kinds of shaders.
vec3 project(vec3 corner, int axis) {
    vec4 point = vec4(corner, 1.0);
    precise vec2 map = vec2(dot(rows[axis], point), dot(rows[axis + 1], point));
    return vec3(round(map * GRID) / GRID, dot(rows[axis + 2], point));
}
