// Study texture-handles, fragments: a texture, by its handle or on its unit.

#if HANDLES
#extension GL_ARB_bindless_texture : require

// Flat, and one value for all of a draw: a sampler that differs within a draw is undefined here too.
layout(location = 1) flat in uvec2 in_handle;
#else
layout(BIND(0, 0, 0)) uniform sampler2D shown;
#endif

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
#if HANDLES
    out_color = texture(sampler2D(in_handle), in_uv);
#else
    out_color = texture(shown, in_uv);
#endif
}
