// A level ground that the spheres of sphere_shadow.glsl shade; put that file's text before this one.

const float SUN_ANGLE = 0.1;  // angular radius of the sun, as on a hazy day

// Light that the ground reflects at `point`. `paper` is its colour, `light` the unit vector towards the sun; `sun` and
// `sky` are the light of each on a surface that faces it and from which nothing hides it. y points up.
vec3 shadedGround(vec3 point, vec3 paper, vec3 light, vec3 sun, vec3 sky) {
    vec3 direct = sun * max(0.0, light.y) * lightPastSpheres(point, light, SUN_ANGLE);
    return paper * (direct + sky * skyPastSpheres(point, vec3(0.0, 1.0, 0.0)));
}
