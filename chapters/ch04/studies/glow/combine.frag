// Studies names, barriers and memory: the picture, and around its lights their glow.

layout(BIND(0, 0, 0)) uniform sampler2D scene;
layout(BIND(0, 1, 1)) uniform sampler2D halo;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(halo, 0) - 1;
    vec3 light = texelFetch(scene, here, 0).rgb + 3.0 * texelFetch(halo, min(here / 2, last), 0).rgb;
    out_color = vec4(light, 1.0);
}
