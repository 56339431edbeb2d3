// The sums of all paths of a picture: images of the frame before, and those of this frame.

#include "paths/error.glsl"
#include "paths/frame.glsl"
#include "finite.glsl"

layout(BIND(3, PATH_BINDING, 0), rgba32f) uniform readonly image2D paths_before;
layout(BIND(3, PATH_BINDING + 1, 1), rgba32f) uniform readonly image2D squares_before;
layout(BIND(3, PATH_BINDING + 4, 2), rgba32f) uniform writeonly image2D history_paths;    // rgb: sums in nits, a: paths
layout(BIND(3, PATH_BINDING + 5, 3), rgba32f) uniform writeonly image2D history_squares;  // x: of luminance; y: paths left out
layout(BIND(3, PATH_BINDING + 6, 4), FORMAT) uniform writeonly image2D color_traced;

// Whether the pixels around one, a block of 4 x 4, have paths enough. All of a block say the same. A part of a larger picture
// (path.crop) has the blocks of that picture. Where a block crosses the edge of the part, its pixels inside of the part count.
bool is_done(ivec2 pixel, ivec2 size) {
    if (path.choice.z == 0.0) {
        return false;
    }
    ivec2 crop = ivec2(path.crop.xy), corner = ((pixel + crop) & ~3) - crop;
    ivec2 first = max(corner, ivec2(0)), end = min(corner + 4, size);
    float sum = 0.0;
    for (int y = first.y; y < end.y; ++y) {
        for (int x = first.x; x < end.x; ++x) {
            vec4 paths = imageLoad(paths_before, ivec2(x, y));
            if (paths.a < LEAST_PATHS) {
                return false;
            }
            sum += relative_error2(paths, imageLoad(squares_before, ivec2(x, y)).x, exposure());
        }
    }
    ivec2 sides = end - first;
    return sum <= path.choice.z * float(sides.x * sides.y);
}

// How many paths of the frame a pixel gets.
uint paths_of(ivec2 pixel, ivec2 size) {
    return path.samples.z != 0u && is_done(pixel, size) ? 0u : path.samples.y;
}

// Adds the light of a path to sums of the frame. Light that is no number, or infinite, is counted and left out.
void add_path(vec3 seen, inout vec4 own, inout vec2 own_squares) {
    vec3 light = seen / exposure();
    float seen2 = luminance(light) * luminance(light);
    if (all(lessThan(abs(vec4(light, seen2)), vec4(FAR)))) {  // neither NaN nor infinite
        own += vec4(light, 1.0);
        own_squares.x += seen2;
    } else {
        own_squares.y += 1.0;
    }
}

// Adds sums of the frame to those of the frames before, and shows their mean.
void store_sums(ivec2 pixel, vec4 own, vec2 own_squares) {
    bool goes_on = path.samples.z != 0u;
    vec4 sum = goes_on ? imageLoad(paths_before, pixel) : vec4(0.0);
    vec2 squares = goes_on ? imageLoad(squares_before, pixel).xy : vec2(0.0);
    sum += own;
    squares += own_squares;
    imageStore(history_paths, pixel, sum);
    imageStore(history_squares, pixel, vec4(squares, 0.0, 0.0));
    imageStore(color_traced, pixel, vec4(finite_color(sum.rgb * (exposure() / max(sum.a, 1.0))), 1.0));
}
