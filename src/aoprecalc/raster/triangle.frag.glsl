// Which face lies under the sample, and where: the weights of its second and third corner.

uniform vec2 sample_at;
uniform vec2 origin;

flat in vec2 a;
flat in vec2 b;
flat in vec2 c;
flat in float face;
out vec4 surface;

float area(vec2 u, vec2 v) {
    return u.x * v.y - u.y * v.x;
}

void main() {
    vec2 wanted = floor(gl_FragCoord.xy) + origin + sample_at - a;
    float whole = area(b - a, c - a);
    vec2 weights = vec2(area(wanted, c - a), area(b - a, wanted)) / (whole == 0.0 ? 1.0 : whole);
    surface = vec4(face + 1.0, weights, 0.0);
}
