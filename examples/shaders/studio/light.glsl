// The studio's lamps, and how colours are written.

const vec3 SUN = vec3(0.84, 0.77, 0.66), SKY = vec3(0.37, 0.41, 0.47), BOUNCE = vec3(0.36, 0.33, 0.29);
uniform vec3 light;
out vec4 pixel;

void write(vec3 color) {  // linear to sRGB (IEC 61966-2-1)
    color = clamp(color, 0.0, 1.0);
    vec3 curve = 1.055 * pow(color, vec3(1.0 / 2.4)) - 0.055;
    pixel = vec4(mix(12.92 * color, curve, greaterThan(color, vec3(0.0031308))), 1.0);
}
