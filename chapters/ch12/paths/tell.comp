// What is known of the errors of a picture: sums for parts of its pixels, which the CPU adds up.
//
// A group sums every GROUPS * THREADS-th run of pixels, in a fixed order, so the same picture gives the same bits.

layout(local_size_x = THREADS) in;

#include "scene/scene.glsl"
#include "paths/error.glsl"

layout(BIND(3, 0, 0), rgba32f) uniform readonly image2D history_paths;
layout(BIND(3, 1, 1), rgba32f) uniform readonly image2D history_squares;
layout(BIND(3, 2, 5), std430) writeonly buffer Path_told_ { vec4 path_told[]; };

shared vec4 partial[THREADS];

void main() {
    ivec2 size = imageSize(history_paths);
    int pixels = size.x * size.y, step = int(gl_NumWorkGroups.x) * THREADS;
    vec4 sum = vec4(0.0);  // x: squares of relative errors, y: paths, z: paths left out
    for (int i = int(gl_GlobalInvocationID.x); i < pixels; i += step) {
        ivec2 pixel = ivec2(i % size.x, i / size.x);
        vec4 paths = imageLoad(history_paths, pixel), squares = imageLoad(history_squares, pixel);
        sum += vec4(relative_error2(paths, squares.x, exposure()), paths.a, squares.y, 0.0);
    }
    uint thread = gl_LocalInvocationID.x;
    partial[thread] = sum;
    for (uint half_ = uint(THREADS) / 2u; half_ > 0u; half_ /= 2u) {
        barrier();
        if (thread < half_) {
            partial[thread] += partial[thread + half_];
        }
    }
    if (thread == 0u) {
        path_told[gl_WorkGroupID.x] = partial[0];
    }
}
