// Study shader-chain: how light a pixel is chooses one of 256 colours.

layout(BIND(0, 0, 0)) uniform sampler2D source;
layout(BIND(0, 1, 1)) uniform sampler2D ramp;

layout(location = 0) out vec4 out_color;

void main() {
    vec4 color = texelFetch(source, ivec2(gl_FragCoord.xy), 0);
    float light = dot(color.rgb, vec3(0.2126, 0.7152, 0.0722));  // weights of Rec. 709
    out_color = vec4(texelFetch(ramp, ivec2(clamp(light, 0.0, 1.0) * 255.0 + 0.5, 0), 0).rgb, color.a);
}
