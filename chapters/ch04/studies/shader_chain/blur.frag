// Study shader-chain: a blur along rows, or down columns. Both in a row blur like 25 weights, and read ten texels.

layout(BIND(0, 0, 0)) uniform sampler2D source;

layout(location = 0) out vec4 out_color;

const float WEIGHTS[5] = float[](1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0);

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(source, 0) - 1;
    out_color = vec4(0.0);
    for (int i = 0; i < 5; i++) {
        ivec2 there = here + (DOWN == 1 ? ivec2(0, i - 2) : ivec2(i - 2, 0));
        out_color += WEIGHTS[i] * texelFetch(source, clamp(there, ivec2(0), last), 0);
    }
}
