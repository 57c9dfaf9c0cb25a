// Blended with MAX: the first channel keeps the depth nearest to the axis' positive end, the second to its negative end.

in float depth;
out vec2 ends;

void main() {
    ends = vec2(depth, -depth);
}
