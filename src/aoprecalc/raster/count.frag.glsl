// Blended by addition: the number of triangles over the sample.

out float count;

void main() {
    count = 1.0;
}
