// One triangle over the whole picture, behind everything else, with the camera's ray through each pixel.

uniform mat3 rays;
out vec3 ray;

void main() {
    vec2 corner = vec2(gl_VertexID % 2, gl_VertexID / 2) * 4.0 - 1.0;
    ray = rays * vec3(corner, 1.0);
    gl_Position = vec4(corner, 1.0, 1.0);
}
