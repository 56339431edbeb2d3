// Which instance is nearest at each pixel: its id plus one, so that 0 is the background.

#include "scene/scene.glsl"
#include "material.glsl"

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

layout(location = 0) out uint out_id;

void main() {
#ifdef ALPHA_MASK
    Material material = materials[instance_of(in_instance).material];
    float alpha = material.base_color.a;
#ifdef VERTEX_COLOR
    alpha *= in_color.a;
#endif
#ifdef BASE_COLOR_MAP
    alpha *= sample_map(base_color_map, image_uv(material, 0, in_uv0, in_uv1)).a;
#endif
    if (alpha < material.emissive.a) {
        discard;
    }
#endif
    out_id = in_instance + 1u;
}
