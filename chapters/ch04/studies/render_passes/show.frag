// Study render-passes: the target, darker towards the corners of the picture.

layout(BIND(0, 0, 0)) uniform sampler2D target;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec2 away = in_uv * 2.0 - 1.0;
    out_color = vec4(texelFetch(target, ivec2(gl_FragCoord.xy), 0).rgb * (1.0 - 0.3 * dot(away, away)), 1.0);
}
