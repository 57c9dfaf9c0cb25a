// The mesh: ambient light by its texture, and sunlight.

const vec3 STONE = vec3(0.80, 0.77, 0.72);
uniform sampler2D baked;
in vec3 normal;
in vec2 uv;

void main() {
    vec3 n = normalize(gl_FrontFacing ? normal : -normal);
    float occlusion = ambientOcclusion(baked, uv), cosine = max(0.0, dot(n, light));
    vec3 ambient = ambientLight(occlusion, mix(BOUNCE, SKY, 0.5 + 0.5 * n.y));
    write(STONE * (ambient + SUN * cosine * seenThroughOpening(occlusion, cosine)));
}
