// Up to six levels of the depth pyramid at once: a work group reduces a tile of 64x64 texels of its source to one
// texel.
//
// Each invocation reads 8x8 texels, each texel once, and has three levels of them. Its last texel goes to shared
// memory, where four invocations make the next two levels, and one makes the last. So a group waits once, and few
// invocations do: at a barrier a software driver puts the state of every invocation aside, and groups of 256, each of
// which reads 4x4 texels, take 1.5 times as long on it. Nothing depends on the size of a subgroup.
//
// SAMPLES: the picture has that many samples per pixel. What is behind a pixel is behind the farthest of them.

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 numbers;  // level of the source, 0 for the picture; width and height of the picture
};
PUSH(Push, push)

#ifdef SAMPLES
layout(BIND(0, 0, 0)) uniform sampler2DMS depth;
#else
layout(BIND(0, 0, 0)) uniform sampler2D depth;
#endif
layout(BIND(0, 1, 0), std430) buffer Pyramid_ { float pyramid[]; };

#include "culling/pyramid.glsl"

uint first[7];   // word of each level: the source, and the six above it
uvec2 size[7];   // zero for a level above the last
uint picture_word;

shared float eighths[64];  // of a tile, 8x8: three levels above the source

void find_levels() {
    uvec2 picture = push.numbers.yz;
    uint source = push.numbers.x, last = pyramid_levels(picture);
    first[0] = pyramid_offset(source, picture);
    size[0] = pyramid_size(source, picture);
    picture_word = picture_offset(picture);
    uint words = pyramid_offset(source + 1u, picture);
    for (uint above = 1u; above < 7u; ++above) {
        first[above] = words;
        size[above] = source + above > last ? uvec2(0u) : (size[above - 1u] + 1u) / 2u;
        words += size[above].x * size[above].y;
    }
}

void store(uint above, uvec2 at, float value) {
    if (all(lessThan(at, size[above]))) {
        pyramid[first[above] + at.y * size[above].x + at.x] = value;
    }
}

// The bits of NaN are above those of infinity. A pixel without a depth hides nothing, like the sky.
float known_depth(float value) { return (floatBitsToUint(value) & 0x7FFFFFFFu) > 0x7F800000u ? 0.0 : value; }

// Keeps 2x2 pixels as well: below left, below right, right, left, as a gather has them.
void keep_picture(uvec2 low, uvec2 high, vec4 depths) {
    uint below = picture_word + high.y * size[0].x, above = picture_word + low.y * size[0].x;
    pyramid[below + low.x] = depths.x;
    pyramid[below + high.x] = depths.y;
    pyramid[above + high.x] = depths.z;
    pyramid[above + low.x] = depths.w;
}

float smallest(vec4 values) { return min(min(values.x, values.y), min(values.z, values.w)); }

#ifdef SAMPLES
float pixel_depth(uvec2 pixel) {
    float farthest = known_depth(texelFetch(depth, ivec2(pixel), 0).x);
    for (int number = 1; number < SAMPLES; ++number) {
        farthest = min(farthest, known_depth(texelFetch(depth, ivec2(pixel), number).x));
    }
    return farthest;
}
#endif

// The minimum of the source's 2x2 texels from `at` on. In the place of a texel beyond the edge it takes the last one
// inside, which every target texel has below it that has texels beyond the edge as well: no minimum changes.
float square_minimum(uvec2 at) {
    uvec2 end = size[0] - 1u, low = min(at, end), high = min(at + 1u, end);
    if (push.numbers.x > 0u) {
        uint above = first[0] + low.y * size[0].x, below = first[0] + high.y * size[0].x;
        return smallest(vec4(
            pyramid[above + low.x], pyramid[above + high.x], pyramid[below + low.x], pyramid[below + high.x]
        ));
    }
#ifdef SAMPLES
    vec4 texels = vec4(
        pixel_depth(uvec2(low.x, high.y)), pixel_depth(high), pixel_depth(uvec2(high.x, low.y)), pixel_depth(low)
    );
    keep_picture(low, high, texels);
    return smallest(texels);
#else
    // One gather reads the four texels around a corner, in less than half the time of four fetches on a software
    // driver. The corner is kept inside: what would be read beyond the edge depends on the sampler.
    uvec2 corner = min(at, max(size[0], 2u) - 2u);
    vec4 texels = textureGather(depth, vec2(corner + 1u) / vec2(size[0]));  // below left, below right, right, left
    texels = vec4(known_depth(texels.x), known_depth(texels.y), known_depth(texels.z), known_depth(texels.w));
    texels = low.x > corner.x ? texels.yyzz : texels;
    texels = low.y > corner.y ? texels.xyyx : texels;
    keep_picture(low, high, texels);
    return smallest(texels);
#endif
}

void main() {
    find_levels();
    uint me = gl_LocalInvocationIndex;
    uvec2 tile = gl_WorkGroupID.xy, own = tile * 8u + gl_LocalInvocationID.xy;

    float eighth = 0.0;
    for (uint y = 0u; y < 2u; ++y) {
        for (uint x = 0u; x < 2u; ++x) {
            uvec2 quarter = own * 2u + uvec2(x, y);
            vec4 halves;
            for (uint number = 0u; number < 4u; ++number) {
                uvec2 at = quarter * 2u + uvec2(number & 1u, number >> 1u);
                halves[number] = square_minimum(at * 2u);
                store(1u, at, halves[number]);
            }
            float least = smallest(halves);
            store(2u, quarter, least);
            eighth = x + y == 0u ? least : min(eighth, least);
        }
    }
    store(3u, own, eighth);
    eighths[me] = eighth;
    barrier();

    if (me < 4u) {
        uvec2 place = uvec2(me & 1u, me >> 1u);
        vec4 parts;
        for (uint number = 0u; number < 4u; ++number) {
            uvec2 at = place * 2u + uvec2(number & 1u, number >> 1u);
            uint corner = 16u * at.y + 2u * at.x;
            parts[number] = smallest(vec4(
                eighths[corner], eighths[corner + 1u], eighths[corner + 8u], eighths[corner + 9u]
            ));
            store(4u, tile * 4u + at, parts[number]);
        }
        store(5u, tile * 2u + place, smallest(parts));
    }
    if (me == 0u) {
        for (uint number = 1u; number < 64u; ++number) {
            eighth = min(eighth, eighths[number]);
        }
        store(6u, tile, eighth);
    }
}
