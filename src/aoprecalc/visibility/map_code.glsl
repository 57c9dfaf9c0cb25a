// The code of a map texel: an occluder's depth at the texel's centre and the slopes of its plane, in one number ordered by
// depth, so that the greatest of several is the nearest occluder with its slopes.
//
// The number is the bits of a positive float. Floats and their bits have the same order, so that blending (on floats) and
// atomic operations (on integers) agree on the greatest. Denormal numbers, which blending may change, infinity and NaN are
// not used. 0 is an empty texel.

const uint MIN_CODE = 0x00800000u;  // the smallest normal float
const float DEPTHS = 260000.0;      // steps of depth in [0, 1]: 19 bits with the sign, less the unused floats
const int ZERO_DEPTH = 260096;      // the code of depth 0
const float SLOPE_STEPS = 31.0;     // of a slope in [0, inf): 6 bits with the sign for each of two
const float MAX_FOLDED = 0.99;      // of the unit interval to which slopes are mapped
const float ROUNDING = 5e-6;        // error of a decoded depth: half a step, and that of interpolation in 32 bits

// Maps a slope from (-inf, inf) to 0 .. 62, finest about 0.
uint slopeCode(float slope) {
    return uint(round(SLOPE_STEPS * (1.0 + slope / (1.0 + abs(slope)))));
}

float slopeOf(uint code) {
    float folded = float(code) / SLOPE_STEPS - 1.0;
    return folded / (1.0 - min(abs(folded), MAX_FOLDED));
}

// Greatest difference between a slope and its decoded value: half a step.
vec2 slopeError(vec2 slope) {
    return (1.0 + abs(slope)) * (1.0 + abs(slope)) * (0.5 / SLOPE_STEPS);
}

uint slopesCode(vec2 slope) {
    return slopeCode(slope.x) << 6 | slopeCode(slope.y);
}

// Occluders lie within 1 of the origin; only interpolation across a sliver gives depths beyond.
uint mapCode(float depth, uint slopes) {
    return MIN_CODE + (uint(int(floor(clamp(depth, -1.0, 1.0) * DEPTHS)) + ZERO_DEPTH) << 12 | slopes);
}

// Returns the depth and the two slopes.
vec3 mapDecode(uint bits) {
    uint code = bits - MIN_CODE;
    float depth = (float(int(code >> 12) - ZERO_DEPTH) + 0.5) / DEPTHS;
    return vec3(depth, slopeOf(code >> 6 & 63u), slopeOf(code & 63u));
}
