// Added up: how many triangles lie over the sample.

out float count;

void main() {
    count = 1.0;
}
