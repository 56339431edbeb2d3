// Studies names, barriers and memory: light as a picture, x / (1 + x) in each channel, as sRGB codes.

layout(BIND(0, 0, 0)) uniform sampler2D glow;

layout(location = 0) out vec4 out_color;

void main() {
    vec3 light = texelFetch(glow, ivec2(gl_FragCoord.xy), 0).rgb;
    vec3 shown = light / (1.0 + light);
    vec3 code = mix(1.055 * pow(shown, vec3(1.0 / 2.4)) - 0.055, 12.92 * shown, lessThanEqual(shown, vec3(0.0031308)));
    out_color = vec4(code, 1.0);
}
