// Triangles moved along the light onto the ground.

uniform vec3 light;    // the unit vector towards it
uniform float ground;  // height
uniform vec3 window;   // x and z of the square's first corner, and its side
uniform float depth;
in vec3 in_position;

void main() {
    vec2 place = in_position.xz - light.xz * (in_position.y - ground) / light.y;
    gl_Position = vec4((place - window.xy) / window.z * 2.0 - 1.0, depth, 1.0);
}
