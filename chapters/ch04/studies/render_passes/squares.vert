// Study render-passes, vertices: square number i, 18/24 of the picture's half wide, at a place and depth of its own.

layout(location = 0) flat out vec4 out_color;

const int CORNERS[6] = int[](0, 1, 2, 2, 1, 3);

void main() {
    int number = INSTANCE_ID, corner = CORNERS[VERTEX_ID];
    vec2 first = vec2(number * 5 % 24 - 20, number * 7 % 24 - 20);
    // Depth has another order than the draws, so that those of the second pass are partly behind those of the first.
    float depth = float(number * 11 % 24 + 1) / 25.0;
    gl_Position = vec4((first + 18.0 * vec2(corner & 1, corner >> 1)) / 24.0, depth, 1.0);
    out_color = vec4(vec3(number * 5 % 8, number * 3 % 8, number % 8) / 7.0, 1.0);
}
