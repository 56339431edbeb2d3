// Studies names, barriers and memory: a Gaussian blur along rows, or down columns.

layout(BIND(0, 0, 0)) uniform sampler2D source;

layout(location = 0) out vec4 out_color;

const int RADIUS = 12;
const float SIGMA = 5.0;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(source, 0) - 1;
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int i = -RADIUS; i <= RADIUS; i++) {
        float weight = exp(-0.5 * float(i * i) / (SIGMA * SIGMA));
        ivec2 there = here + (DOWN == 1 ? ivec2(0, i) : ivec2(i, 0));
        sum += weight * texelFetch(source, clamp(there, ivec2(0), last), 0);
        total += weight;
    }
    out_color = sum / total;
}
