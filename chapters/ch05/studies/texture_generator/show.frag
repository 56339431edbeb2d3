// Study texture-generator, fragments: the texture over the whole picture, each texel with hard edges.

layout(BIND(0, 0, 0)) uniform sampler2D generated;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    out_color = textureLod(generated, in_uv, 0.0);
}
