// What a map texel holds: an occluder's depth at the texel's centre and the slope of the occluder's plane, in one 32-bit
// float that is ordered by depth, so that blending with MAX keeps the nearest occluder and its slope with it.
//
// The float is made of its bits: those of positive floats are ordered as whole numbers are, those of negative ones the
// other way round. Denormal numbers, infinities and NaNs are left out, as blending may change them.

const float DEPTHS = 513802.0;      // steps of depth in [0, 1]: 20 bits with the sign, less a margin for EMPTY
const float NOTHING = -1.005;       // depths below are of cleared texels
const float SLOPE_STEPS = 31.0;     // in [0, inf): 6 bits with the sign for each of two slopes
const float STEEPEST = 0.99;        // of the unit interval into which slopes are folded
const float ROUNDING = 4e-6;        // of a decoded depth: half a step, and what interpolating in 32 bits adds

// A slope folded from (-inf, inf) into 0 .. 62, finest about 0.
int slopeCode(float slope) {
    return int(round(SLOPE_STEPS * (1.0 + slope / (1.0 + abs(slope)))));
}

float slopeOf(int code) {
    float folded = float(code) / SLOPE_STEPS - 1.0;
    return folded / (1.0 - min(abs(folded), STEEPEST));
}

// How far a slope may be from the one that was coded: half a step.
vec2 slopeError(vec2 slope) {
    return (1.0 + abs(slope)) * (1.0 + abs(slope)) * (0.5 / SLOPE_STEPS);
}

float mapCode(float depth, vec2 slope) {
    int code = int(floor(depth * DEPTHS)) << 12 | slopeCode(slope.x) << 6 | slopeCode(slope.y);
    return uintBitsToFloat(code >= 0 ? 0x00800000u + uint(code) : 0x80800000u + uint(~code));
}

// Returns the depth and the two slopes.
vec3 mapDecode(float value) {
    uint bits = floatBitsToUint(value);
    int code = bits < 0x80000000u ? int(bits - 0x00800000u) : ~int(bits - 0x80800000u);
    return vec3((float(code >> 12) + 0.5) / DEPTHS, slopeOf(code >> 6 & 63), slopeOf(code & 63));
}
