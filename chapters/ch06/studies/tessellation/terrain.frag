// Study tessellation, fragments: a colour for the level of the patch, a lamp, and the edges of the small triangles.

#include "palette.glsl"

#if EDGES || RECORDED
layout(location = 0) in vec3 in_normal;
layout(location = 1) in float in_level;
layout(location = 2) noperspective in vec3 in_weights;
#else
layout(location = 1) in vec3 in_normal;
layout(location = 2) in float in_level;
#endif
layout(location = 0) out vec4 out_color;

const float THICKNESS = 1.0;  // pixels from an edge to the full colour of the face

void main() {
    // A level of 1 is blue, 3 green, 5 and above yellow to red.
    vec3 color = mix(vec3(0.45), heat(0.15 + 0.1 * in_level), 0.6);
    color *= 0.3 + 0.7 * max(dot(normalize(in_normal), normalize(vec3(0.5, 0.7, 0.25))), 0.0);
#if EDGES
    // Each weight is 0 along one edge and changes evenly over the picture; over its slope it is a distance in pixels.
    vec3 along_x = dFdx(in_weights), along_y = dFdy(in_weights);
    vec3 pixels = in_weights / max(sqrt(along_x * along_x + along_y * along_y), 1e-20);
    float nearest = clamp(min(min(pixels.x, pixels.y), pixels.z) / THICKNESS, 0.0, 1.0);
    color *= mix(0.3, 1.0, nearest);
#endif
    out_color = vec4(color, 1.0);
}
