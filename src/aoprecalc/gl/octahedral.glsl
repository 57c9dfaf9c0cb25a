// Unit vectors in 32 bits: the octahedron unfolded to a square, 16 bits a side
// (Q. Meyer, J. Suessmuth, G. Sussner, M. Stamminger, G. Greiner, "On Floating-Point Normal Vectors", 2010).

vec2 fold(vec2 square) {
    return (1.0 - abs(square.yx)) * mix(vec2(-1.0), vec2(1.0), greaterThanEqual(square, vec2(0.0)));
}

uint packUnit(vec3 unit) {
    vec2 square = unit.xy / (abs(unit.x) + abs(unit.y) + abs(unit.z));
    return packSnorm2x16(unit.z >= 0.0 ? square : fold(square));
}

vec3 unpackUnit(uint bits) {
    vec2 square = unpackSnorm2x16(bits);
    float z = 1.0 - abs(square.x) - abs(square.y);
    return normalize(vec3(z >= 0.0 ? square : fold(square), z));
}
