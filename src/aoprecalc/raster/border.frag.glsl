// A texel that the surface covers in part, but not at its sample: takes the point of the border, within the texel's
// square, that is nearest to the sample. At a concave edge a sample on the border lies in the neighbouring face, so that
// face cannot occlude it; samples are moved inwards. Depth grows with the distance from the sample, so the nearest border
// wins, and any triangle before it. layout.py explains the constants; cpu_rasterizer.py follows the same rules.

uniform vec2 sample_at;
uniform vec2 origin;

flat in vec2 start;
flat in vec2 end;
flat in vec2 apex;
flat in float face;
flat in int corner;
out vec4 surface;

void main() {
    vec2 square = floor(gl_FragCoord.xy) + origin;
    vec2 low = square + INSET, high = square + 1.0 - INSET;
    vec2 along = end - start;

    // Clip the border to the square, slab by slab.
    float enter = 0.0, leave = 1.0;
    for (int axis = 0; axis < 2; axis++) {
        if (abs(along[axis]) < 1e-9) {
            if (start[axis] < low[axis] || start[axis] > high[axis]) discard;
            continue;
        }
        vec2 cut = (vec2(low[axis], high[axis]) - start[axis]) / along[axis];
        enter = max(enter, min(cut.x, cut.y));
        leave = min(leave, max(cut.x, cut.y));
    }
    if (enter > leave) discard;

    vec2 target = square + sample_at;
    float t = clamp(dot(target - start, along) / max(dot(along, along), 1e-20), enter, leave);
    vec2 inward = apex - (start + t * along);
    float height = abs(along.x * inward.y - along.y * inward.x) / max(length(along), 1e-9);
    float share = min(MAX_SHARE, min(OFFSET / max(height, 1e-9), MAX_MOVE / max(length(inward), 1e-9)));
    vec3 weights = vec3(share);
    weights[corner] = (1.0 - share) * (1.0 - t);
    weights[(corner + 1) % 3] = (1.0 - share) * t;
    surface = vec4(face + 1.0, weights.yz, 0.0);
    gl_FragDepth = BORDER_DEPTH + DEPTH_PER_TEXEL * distance(target, start + t * along);
}
