// Study shader-chain: the original, and again what a blur has taken from it (unsharp masking). It reads two pictures.

layout(BIND(0, 0, 0)) uniform sampler2D source;    // blurred, by the passes before
layout(BIND(0, 1, 1)) uniform sampler2D original;

layout(location = 0) out vec4 out_color;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy);
    vec4 sharp = texelFetch(original, here, 0);
    out_color = vec4(sharp.rgb + 1.5 * (sharp.rgb - texelFetch(source, here, 0).rgb), sharp.a);
}
