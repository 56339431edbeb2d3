// The visibility buffer: which triangle is nearest at each pixel. Only a masked material is asked for its texture.

#include "scene/scene.glsl"
#include "shading/material.glsl"

#ifdef TEXTURED
layout(location = 3) in vec2 in_uv0;
#else
const vec2 in_uv0 = vec2(0.0);
#endif
#ifdef UV1
layout(location = 4) in vec2 in_uv1;
#else
const vec2 in_uv1 = vec2(0.0);
#endif
#ifdef VERTEX_COLOR
layout(location = 5) in vec4 in_color;
#endif
layout(location = 6) flat in uint in_instance;
layout(location = 7) flat in uint in_index;  // the place in the mesh of the first index of this draw or meshlet

layout(location = 0) out uvec2 out_ids;

void main() {
#ifdef ALPHA_MASK
    Material material = materials[instance_of(in_instance).material];
    vec4 color = material.base_color;
#ifdef VERTEX_COLOR
    color *= in_color;
#endif
#ifdef BASE_COLOR_MAP
    color *= sample_map(base_color_map, image_uv(material, 0, in_uv0, in_uv1));
#endif
    if (color.a < material.emissive.a) {
        discard;
    }
#endif
    out_ids = uvec2(in_instance + 1u, (in_index + 3u * uint(gl_PrimitiveID)) | (gl_FrontFacing ? 0u : BACK));
}
