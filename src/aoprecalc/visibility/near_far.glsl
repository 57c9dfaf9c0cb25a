// How corners come into the maps of a batch of axes: one map an axis, in tiles.

layout(std140, binding = 0) uniform Axes { vec4 rows[5 * AXES]; };

// Where a corner lies in its map, on the grid that rasterisers know, and its depth; the same in all kinds of shaders.
vec3 project(vec3 corner, int axis) {
    vec4 point = vec4(corner, 1.0);
    precise vec2 map = vec2(dot(rows[axis], point), dot(rows[axis + 1], point));
    return vec3(round(map * GRID) / GRID, dot(rows[axis + 2], point));
}
