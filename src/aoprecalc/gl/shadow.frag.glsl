// One more direction from which no light comes.

out float count;

void main() {
    count = 1.0;
}
