// A triangle of the atlas, moved so that fragments are sampled at `sample_at` in each texel's square, not at its centre.
//
// Rasterizers snap vertices to the grid (GRID, see layout.py). Snapping first makes the result the same in every band,
// except that an edge may move slightly in triangles that the edge of a band clips, as clipped corners are snapped again.

uniform vec2 sample_at;  // in [0, 1)^2
uniform vec2 origin;     // first texel of the band
uniform vec2 size;       // texels of the band

in vec2 in_a;
in vec2 in_b;
in vec2 in_c;
in float in_face;
flat out vec2 a;
flat out vec2 b;
flat out vec2 c;
flat out float face;

void main() {
    a = in_a;
    b = in_b;
    c = in_c;
    face = in_face;
    int corner = gl_VertexID % 3;
    vec2 texel = (corner == 0 ? a : corner == 1 ? b : c) + 0.5 - sample_at;
    texel = round(texel * GRID) / GRID - origin;
    gl_Position = vec4(texel / size * 2.0 - 1.0, -1.0, 1.0);
}
