// Study buffer-address, fragments: rings around the middle of each face.

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    float ring = fract(6.0 * length(in_uv - 0.5));
    out_color = vec4(mix(vec3(in_uv, 0.6), vec3(0.1, 0.1, 0.2), step(0.5, ring)), 1.0);
}
