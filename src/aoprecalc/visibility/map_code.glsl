// What a map texel holds: an occluder's depth at the texel's centre and the slope of the occluder's plane, in one number
// that is ordered by depth, so that the greatest of several is the nearest occluder with its slope.
//
// The number is the bits of a positive float, whose order is that of its bits: blending, which takes floats, and atomic
// operations, which take whole numbers, agree on the greatest. Denormal numbers are left out, as blending may change them,
// infinity and NaN, too. 0 is nothing.

const uint LEAST = 0x00800000u;     // the first normal float
const float DEPTHS = 260000.0;      // steps of depth in [0, 1]: 19 bits with the sign, less what is left out
const int MIDDLE = 260096;          // the code of depth 0
const float SLOPE_STEPS = 31.0;     // in [0, inf): 6 bits with the sign for each of two slopes
const float STEEPEST = 0.99;        // of the unit interval into which slopes are folded
const float ROUNDING = 5e-6;        // of a decoded depth: half a step, and what interpolating in 32 bits adds

// A slope folded from (-inf, inf) into 0 .. 62, finest about 0.
uint slopeCode(float slope) {
    return uint(round(SLOPE_STEPS * (1.0 + slope / (1.0 + abs(slope)))));
}

float slopeOf(uint code) {
    float folded = float(code) / SLOPE_STEPS - 1.0;
    return folded / (1.0 - min(abs(folded), STEEPEST));
}

// How far a slope may be from the one that was coded: half a step.
vec2 slopeError(vec2 slope) {
    return (1.0 + abs(slope)) * (1.0 + abs(slope)) * (0.5 / SLOPE_STEPS);
}

uint slopesCode(vec2 slope) {
    return slopeCode(slope.x) << 6 | slopeCode(slope.y);
}

// Occluders are within 1 of the origin; a depth beyond is one that was interpolated across a sliver.
uint mapCode(float depth, uint slopes) {
    return LEAST + (uint(int(floor(clamp(depth, -1.0, 1.0) * DEPTHS)) + MIDDLE) << 12 | slopes);
}

// Returns the depth and the two slopes.
vec3 mapDecode(uint bits) {
    uint code = bits - LEAST;
    float depth = (float(int(code >> 12) - MIDDLE) + 0.5) / DEPTHS;
    return vec3(depth, slopeOf(code >> 6 & 63u), slopeOf(code & 63u));
}
