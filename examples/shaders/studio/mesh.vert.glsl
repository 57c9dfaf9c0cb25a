// The mesh, moved into the picture.

uniform mat4 camera;
in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
out vec3 normal;
out vec2 uv;

void main() {
    normal = in_normal;
    uv = in_uv;
    gl_Position = camera * vec4(in_position, 1.0);
}
