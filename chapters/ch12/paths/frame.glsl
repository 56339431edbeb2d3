// What paths of a frame are told: a block of the frame's slot (paths/memory.py).

const uint STRATEGY_MIS = 0u, STRATEGY_BSDF = 1u, STRATEGY_LIGHTS = 2u;
const uint PATH_ONE_LIGHT = 1u, PATH_SOBOL = 2u, PATH_BOX = 4u;

layout(BIND(3, PATH_BINDING + 3, 3), std140) uniform Path_frame_ {
    uvec4 samples;   // x: number of the first path, y: paths of each pixel in this frame, z: 1 if earlier sums go on, w: seed
    uvec4 tables;    // x: entries of the environment's table, y: of that of emissive triangles; z: the first number of
                     // triangles and w: the first word of instances, in path_tables
    uvec4 knobs;     // x: reflections of a path at most, y: those after which it may end; z: STRATEGY_*, w: bits PATH_*
    vec4 choice;     // x: probability that a ray towards light goes to the environment; y: texels along an edge of its table;
                     // z: the square of the relative error at which pixels have enough paths; 0: none has
    uvec4 tree;      // of lights that have a place (light_tree.glsl). x: its first record in path_tables, y: its leaves, 0
                     // where lights are few; z: the first record of the lights of leaves
    uvec4 crop;      // where the frame is a part of a larger picture. x, y: the place of the part's first pixel in that
                     // picture; z, w: the size of that picture. A frame that is no part has 0, 0 and its own size
} path;
