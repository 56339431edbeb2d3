// Study linear-depth, vertices: a floor below the lamp, and cards that face it, each twice as far as the one before.

#include "depth.glsl"

const vec2 corners[6] = vec2[](vec2(0, 0), vec2(1, 0), vec2(1, 1), vec2(0, 0), vec2(1, 1), vec2(0, 1));

void main() {
    vec2 corner = corners[VERTEX_ID % 6];
    int card = VERTEX_ID / 6 - 1;
    vec3 p;
    if (card < 0) {
        p = vec3(mix(-200.0, 200.0, corner.x), -FLOOR, mix(0.5 * NEAREST, push.lamp.w, corner.y));
    } else {
        // Card and distance grow together, so all cards are equally large in the picture.
        float z = NEAREST * exp2(float(card));
        float left = (float(card) - 0.5 * float(CARDS)) * 2.0 / float(CARDS) + 0.03;
        float wide = 2.0 / float(CARDS) - 0.06;
        p = vec3(z * push.lamp.x * (left + wide * corner.x), z * push.lamp.y * mix(-0.75, 0.8, corner.y), z);
        p.y = max(p.y, -FLOOR);
    }
    // Row 0 is on top in both APIs, so y points down.
    gl_Position = vec4(p.x / push.lamp.x, -p.y / push.lamp.y, clip_depth(p.z, STANDARD == 1), p.z);
}
