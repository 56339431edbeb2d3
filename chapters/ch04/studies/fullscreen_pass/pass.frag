// Study fullscreen-pass, fragments: where this pixel is, or only that it was here.

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
#if WRITTEN == 0
    out_color = vec4(in_uv, 0.25, 0.5);  // added to nothing: twice would be brighter
#elif WRITTEN == 1
    // Interpolated at the centre of the pixel: column i of W has u = (i + 0.5) / W. The other half is how much uv gains
    // from a pixel to the next, which is what textures choose their mip levels by.
    out_color = vec4(in_uv, dFdx(in_uv.x), dFdy(in_uv.y));
#else
    out_color = vec4(1.0);
#endif
}
