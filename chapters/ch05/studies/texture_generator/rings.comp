// Study texture-generator, a shader: rings around two points that wander, where they meet.
#include "toy.glsl"

void mainImage(out vec4 fragColor, in vec2 fragCoord) {
    vec2 p = (2.0 * fragCoord - iResolution.xy) / iResolution.y;
    vec2 way = vec2(cos(0.7 * iTime), sin(1.1 * iTime));
    float one = sin(14.0 * length(p - 0.6 * way) - 3.0 * iTime);
    float two = sin(14.0 * length(p + 0.6 * way.yx) - 3.0 * iTime);
    float both = 0.5 + 0.25 * (one + two);
    vec3 color = mix(vec3(0.04, 0.08, 0.22), vec3(0.98, 0.62, 0.25), both * both);
    fragColor = vec4(color + 0.35 * pow(both, 8.0), 1.0);
}
