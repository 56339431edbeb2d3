// Blends a layer over what is behind it; a pixel without a surface in this layer has opacity 0.

layout(BIND(0, 0, 0)) uniform sampler2D layer;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    out_color = texelFetch(layer, ivec2(gl_FragCoord.xy), 0);
}
