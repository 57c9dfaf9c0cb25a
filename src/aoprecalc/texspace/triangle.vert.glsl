// A chart's triangle, moved so that its fragments are taken at `sample_at` in each texel's square instead of the centre.

uniform vec2 sample_at;  // in [0, 1)^2
uniform vec2 origin;     // first texel of the band
uniform vec2 size;       // texels of the band

in vec2 in_texel;
in float in_face;
out vec2 weights;
flat out float face;

void main() {
    int corner = gl_VertexID % 3;
    weights = vec2(corner == 1, corner == 2);
    face = in_face;
    gl_Position = vec4((in_texel - origin + 0.5 - sample_at) / size * 2.0 - 1.0, -1.0, 1.0);
}
