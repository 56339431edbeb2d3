// The Khronos PBR Neutral tone curve: colours below 0.8 keep their hue and value, brighter ones are rolled off to white.
//
// Source: Khronos, "PBR Neutral Tone Mapper" specification, 2024. Input and output are linear, sRGB primaries.

const float NEUTRAL_START = 0.8 - 0.04;    // where compression begins: 1 - 0.2 less the Fresnel offset
const float NEUTRAL_DESATURATION = 0.15;

vec3 tone_neutral(vec3 color) {
    // A dielectric under white light reflects 4 % more than its base colour; the toe takes that off again.
    float darkest = min(color.r, min(color.g, color.b));
    float offset = darkest < 0.08 ? darkest - 6.25 * darkest * darkest : 0.04;
    color -= offset;
    float peak = max(color.r, max(color.g, color.b));
    if (peak < NEUTRAL_START) {
        return color;
    }
    float d = 1.0 - NEUTRAL_START;
    float new_peak = 1.0 - d * d / (peak + d - NEUTRAL_START);
    color *= new_peak / peak;
    float gray = 1.0 - 1.0 / (NEUTRAL_DESATURATION * (peak - new_peak) + 1.0);
    return mix(color, vec3(new_peak), gray);
}
