// The face under the sample, plus 1, and the barycentric weights of its second and third corner.

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
    vec2 target = floor(gl_FragCoord.xy) + origin + sample_at - a;
    float whole = area(b - a, c - a);
    vec2 weights = vec2(area(target, c - a), area(b - a, target)) / (whole == 0.0 ? 1.0 : whole);
    surface = vec4(face + 1.0, weights, 0.0);
}
