// Study flipbook, fragments: a picture of the book. Filters mix texels of a layer, never two layers.

layout(BIND(0, 2, 0)) uniform sampler2DArray book;

layout(location = 0) in vec2 in_uv;
layout(location = 1) flat in float in_layer;
layout(location = 0) out vec4 out_color;

void main() {
    // One texture and one descriptor: that the layer differs from instance to instance needs no `nonuniformEXT`.
    out_color = texture(book, vec3(in_uv, in_layer));
}
