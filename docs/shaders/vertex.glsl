#version 330
in vec3 seen, position;
in vec2 uv;
out vec3 place;
out vec2 at;

void main() {
    gl_Position = vec4(seen.xy, -0.5 * seen.z, 1.0);
    place = position;
    at = uv;
}
