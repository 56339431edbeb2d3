// Study wireframe, fragments: face, edge, or both, by how far the edges are.

#include "edge.glsl"
#include "mesh.glsl"

layout(location = 0) noperspective in vec3 in_weights;
layout(location = 0) out vec4 out_color;

void main() {
#if SHOWS == 0
    out_color = vec4(frame.face.rgb, 1.0);
#elif SHOWS == 1
    out_color = vec4(frame.edge.rgb, 1.0);
#else
    float factor = edge_factor(in_weights, dFdx(in_weights), dFdy(in_weights), frame.edge.w);
    out_color = vec4(mix(frame.edge.rgb, frame.face.rgb, factor), 1.0);
#endif
}
