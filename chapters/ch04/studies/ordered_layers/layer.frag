// Study ordered-layers, fragments: the colour of a layer and how much of it there is, from the place in the picture.

#if READS
layout(BIND(0, 0, 0)) uniform sampler2D target;
#endif

layout(location = 0) in vec2 in_uv;  // row 0 on top
layout(location = 0) out vec4 out_color;

const float ASPECT = 16.0 / 9.0;

// From 0 to 1 over `soft`, so that no pixel hangs on the last bit of a comparison.
float cover(float inside, float soft) {
    return clamp(inside / soft, 0.0, 1.0);
}

void main() {
    vec2 p = in_uv;
#if LAYER == 0  // sky
    out_color = vec4(mix(vec3(0.2, 0.4, 0.75), vec3(0.95, 0.8, 0.6), p.y), 1.0);
#elif LAYER == 1  // sun
    float away = length((p - vec2(0.7, 0.45)) * vec2(ASPECT, 1.0));
    out_color = vec4(1.0, 0.9, 0.3, cover(0.22 - away, 0.02));
#elif LAYER == 2  // hills
    out_color = vec4(0.2, 0.4, 0.25, cover(p.y - 0.68 - 0.1 * sin(7.0 * p.x), 0.02));
#elif LAYER == 3  // mist
    out_color = vec4(0.9, 0.9, 0.95, 0.7 * cover(0.2 - abs(p.y - 0.66), 0.2));
#elif LAYER == 4  // map: lines of equal height
    float height = length((p - vec2(0.4, 0.6)) * vec2(ASPECT, 1.0));
    out_color = vec4(mix(vec3(0.3, 0.2, 0.1), vec3(0.9, 0.85, 0.7), 0.5 + 0.5 * cos(40.0 * height)), 1.0);
#else  // inset: each fourth texel of the target, in a quarter of the picture
    ivec2 size = textureSize(target, 0), from = ivec2(gl_FragCoord.xy) - size / 16, texel = 4 * from;
    bool inside = from.x >= 0 && from.y >= 0 && texel.x < size.x && texel.y < size.y;
    out_color = inside ? vec4(texelFetch(target, texel, 0).rgb, 0.85) : vec4(0.0);
#endif
}
