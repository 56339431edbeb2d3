// Study shader-chain: a pass that changes nothing.

layout(BIND(0, 0, 0)) uniform sampler2D source;

layout(location = 0) out vec4 out_color;

void main() {
    // A texel by its number: no filter, and so no rounding.
    out_color = texelFetch(source, ivec2(gl_FragCoord.xy), 0);
}
