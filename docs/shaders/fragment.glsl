#version 330
uniform sampler2D baked;
uniform vec3 box;  // half its sides; it loses a corner, through which one sees its left side, its back and its floor
in vec3 place;
in vec2 at;
out vec4 found;  // occlusion, or -1, -2, -3 inside the box; depth

void main() {
    float key = 0.0;
    if (box.z > 0.0) {
        bool is_floor = !gl_FrontFacing && place.z < -0.99 * box.z;
        if (!is_floor && place.x > -0.1 && place.y < 0.1) discard;
        if (!gl_FrontFacing) key = is_floor ? -3.0 : place.x < -0.99 * box.x ? -1.0 : -2.0;
    }
    found = vec4(key < 0.0 ? key : texture(baked, at).r, gl_FragCoord.z, 0.0, 1.0);
}
