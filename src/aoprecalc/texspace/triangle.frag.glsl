// Which face lies under the sample, and where: the weights of its second and third corner.

in vec2 weights;
flat in float face;
out vec4 surface;

void main() {
    surface = vec4(face + 1.0, weights, 0.0);
}
