// A border, drawn wide enough that every texel whose square it touches gets a fragment. GRID: see triangle.vert.glsl.

const float REACH = 0.75;  // more than half a texel's diagonal

uniform vec2 origin;  // first texel of the band
uniform vec2 size;    // texels of the band

in vec2 in_start;
in vec2 in_end;
in vec2 in_apex;
in float in_face;
in float in_corner;
flat out vec2 start;
flat out vec2 end;
flat out vec2 apex;
flat out float face;
flat out int corner;

void main() {
    start = in_start;
    end = in_end;
    apex = in_apex;
    face = in_face;
    corner = int(in_corner);
    vec2 along = end - start;
    along = dot(along, along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
    vec2 across = vec2(-along.y, along.x);
    bool is_end = gl_VertexID >= 2, is_left = gl_VertexID % 2 == 0;
    vec2 texel = (is_end ? end + REACH * along : start - REACH * along) + (is_left ? REACH : -REACH) * across;
    texel = round(texel * GRID) / GRID - origin;
    gl_Position = vec4(texel / size * 2.0 - 1.0, 0.0, 1.0);
}
