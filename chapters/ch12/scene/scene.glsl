// What every pass of this chapter sees of the scene: set 0, written once per frame and slot. All of it is declared here,
// whether a shader reads it or not, so that all of the scene's pipelines have one layout for this set, and share it.

#include "lights.glsl"
#include "masks.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
#include "frame_constants.glsl"
} frame;

struct Instance {
#include "instance.glsl"
};
layout(BIND(0, 1, 0), std430) readonly buffer Instances_ { Instance instances[]; };
#ifdef INSTANCES_PER_PAGE
layout(BIND(0, 8, 12), std430) readonly buffer More_instances_ { Instance more_instances[]; };
#endif
#include "scene/instance_of.glsl"

struct Mesh {
    uvec4 streams[2];  // the first word of each vertex stream in the mesh's page, in the order of scene/geometry.py;
                       // then that of its indices, and the number of the page
};
layout(BIND(0, 2, 1), std430) readonly buffer Meshes_ { Mesh meshes[]; };

struct Material {
    vec4 base_color;
    vec4 emissive;      // rgb in nits, a: alpha cutoff
    vec4 factors;       // metallic, roughness, normal scale, occlusion strength
    vec4 uv_rows[10];   // two rows for each role: xyz of the 2x3 matrix image_from_uv; w of the first: uv set;
                        // w of the second row of the first role: what visibility/model.py says of the material
    uvec4 maps[2];      // which texture each role samples; see textures.glsl
};
layout(BIND(0, 3, 2), std430) readonly buffer Materials_ { Material materials[]; };

layout(BIND(0, 4, 3), std430) readonly buffer Lights_ {
    uvec4 light_count;  // x: all, y: directional ones, which come first
    Light lights[];
};
#ifdef LISTS_WRITTEN
layout(BIND(0, 9, 13), std430) buffer Light_lists_ { uint light_lists[]; };
#else
layout(BIND(0, 9, 13), std430) readonly buffer Light_lists_ { uint light_lists[]; };
#endif

layout(BIND(0, 5, 0)) uniform samplerCube environment_radiance;
layout(BIND(0, 6, 1)) uniform samplerCube environment_irradiance;
layout(BIND(0, 7, 2)) uniform sampler2D environment_table;

#include "shadows/scene.glsl"
#include "fog/scene.glsl"
#include "hdr/exposure.glsl"
