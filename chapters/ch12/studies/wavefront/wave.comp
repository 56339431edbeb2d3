// The path tracer as stages over queues of paths (Laine, Karras and Aila 2013, "Megakernels Considered Harmful").
//
//     GENERATE    a path for each pixel of the tile -> the queue of live paths
//     NEXT        what the queues hold -> arguments of the next dispatches
//     EXTEND      live paths: the nearest hit
//     SHADE       live paths: light at the hit, rays towards light, a new direction -> the next queue, the queue of shadows
//     SHADOW      paths with rays towards light: what arrives along them
//     ADD         the light of each path -> sums of its pixel
//
// All stages are this text, and the constant STAGE leaves one of them in each pipeline: so all have one layout of bindings.
// The functions are those of the loop in paths/paths.glsl, and the random numbers, too.

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint STAGE = 0u;

const uint GENERATE = 0u, NEXT = 1u, EXTEND = 2u, SHADE = 3u, SHADOW = 4u, ADD = 5u;
const uint MOST_RAYS = 2u;  // towards light, of a path in a round

uvec2 path_pixel = uvec2(0u);
#define RAY_ID path_pixel
#include "paths/steps.glsl"
#include "rays/tile.glsl"
#include "studies/wavefront/wave.glsl"

// What a dispatch is told: x, y: the first pixel of the tile; z: its columns and rows; w: round, bits and sample.
#define COLUMNS (tile.first.z & 0xffffu)
#define ROWS (tile.first.z >> 16u)
#define ROUND (tile.first.w & 0x7ffu)
#define CLEARS ((tile.first.w & 0x800u) != 0u)
#define IS_LAST ((tile.first.w & 0x1000u) != 0u)
#define SAMPLE (tile.first.w >> 16u)

#include "studies/wavefront/queues.glsl"
#include "studies/wavefront/stages.glsl"

void main() {
    uint id = gl_GlobalInvocationID.x;
    if (STAGE == GENERATE) {
        generate(id);
    } else if (STAGE == NEXT) {
        next();
    } else if (STAGE == ADD) {
        add(id);
    } else {
        bool is_shadow = STAGE == SHADOW, within = id < wave_head[is_shadow ? SHADOWS : LIVE];
        uint turn = ROUND & 1u, i = within ? wave[QUEUES * WAVE_PATHS + id][is_shadow ? 2u : turn] : 0u;
        ivec2 pixel;
        pixel_of(i, pixel);
        path_pixel = uvec2(pixel);
        bool goes_on = false, asks = false;
        if (within && STAGE == EXTEND) {
            extend(i);
        }
        if (within && STAGE == SHADE) {
            goes_on = shade(i, asks);
        }
        if (within && STAGE == SHADOW) {
            shadow(i);
        }
        if (STAGE == SHADE) {
            append_live(i, goes_on, turn ^ 1u);
            uint place = place_in(NEXT_SHADOWS, asks);
            if (asks) {
                wave[QUEUES * WAVE_PATHS + place].z = i;
            }
        }
    }
}
