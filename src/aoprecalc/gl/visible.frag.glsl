// The number of the triangle, from 1.

out int triangle;

void main() {
    triangle = gl_PrimitiveID + 1;
}
