// An endless ground of paper, which the spheres shade; above the horizon, paper in full
// light.

const vec3 PAPER = vec3(0.86);
const vec3 UP = vec3(0.0, 1.0, 0.0);
const float SUN_ANGLE = 0.1;
uniform vec3 eye;
uniform float ground;
in vec3 ray;

void main() {
    float sun = 1.0, sky = 1.0;
    if (ray.y < 0.0) {
        vec3 point = eye + ray * (ground - eye.y) / ray.y;
        sun = lightPastSpheres(point, light, SUN_ANGLE);
        sky = skyPastSpheres(point, UP);
    }
    write(PAPER * (ambientLight(sky, SKY) + SUN * sun * light.y));
}
