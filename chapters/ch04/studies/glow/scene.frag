// Studies names, barriers and memory: a dark picture with lamps, whose light is above 1.

layout(location = 0) in vec2 in_uv;  // row 0 on top
layout(location = 0) out vec4 out_color;

const float ASPECT = 1.5;

void main() {
    vec3 light = mix(vec3(0.02, 0.03, 0.08), vec3(0.10, 0.05, 0.06), in_uv.y);
    for (int i = 0; i < 7; i++) {
        vec2 lamp = vec2(0.14 + 0.12 * float(i), 0.5 + 0.28 * sin(2.1 * float(i)));
        float away = length((in_uv - lamp) * vec2(ASPECT, 1.0));
        vec3 color = 0.5 + 0.5 * cos(vec3(0.0, 2.1, 4.2) + float(i));
        // A clear glass bulb: its filament is bright, the glass around it is not.
        light += 4.0 * color * clamp((0.030 - away) / 0.006, 0.0, 1.0);
        light += 0.15 * color * clamp((0.006 - abs(away - 0.07)) / 0.006, 0.0, 1.0);
    }
    out_color = vec4(light, 1.0);
}
