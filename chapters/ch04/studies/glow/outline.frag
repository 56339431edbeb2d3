// Studies names, barriers and memory: how much neighbouring texels differ. No pass reads the result.

layout(BIND(0, 0, 0)) uniform sampler2D scene;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(scene, 0) - 1;
    vec3 light = texelFetch(scene, here, 0).rgb;
    vec3 right = texelFetch(scene, min(here + ivec2(1, 0), last), 0).rgb;
    vec3 below = texelFetch(scene, min(here + ivec2(0, 1), last), 0).rgb;
    out_color = vec4(abs(right - light) + abs(below - light), 1.0);
}
