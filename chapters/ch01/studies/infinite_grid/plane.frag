// Study infinite-grid, fragments: where the ray through a pixel meets the plane, and which lines are there.

#include "grid.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 start[3];  // at the picture's corner; change per pixel to the right; change per pixel down
    vec4 ray[3];
    vec4 plane;     // the eye's height above it, cell, least, radius
    vec4 eye[LEVELS];  // xy: where in a square of each size
} frame;

const vec3 PAPER = vec3(1.0);

layout(location = 0) out vec4 out_color;

void main() {
    vec2 pixel = gl_FragCoord.xy;  // centres lie at halves
    vec3 start = frame.start[0].xyz + pixel.x * frame.start[1].xyz + pixel.y * frame.start[2].xyz;
    vec3 ray = frame.ray[0].xyz + pixel.x * frame.ray[1].xyz + pixel.y * frame.ray[2].xyz;
    float way = -(frame.plane.x + start.y) / ray.y;
    out_color = vec4(PAPER, 1.0);
    if (!(way > 0.0) || isinf(way)) return;  // above the horizon, or along it
    vec2 place = start.xz + way * ray.xz;
    // How the place changes from pixel to pixel: the formula's own derivative. dFdx would ask the neighbouring pixel, and
    // at the horizon that one may never meet the plane.
    vec2 along_x = frame.start[1].xz + way * frame.ray[1].xz - ray.xz * ((frame.start[1].y + way * frame.ray[1].y) / ray.y);
    vec2 along_y = frame.start[2].xz + way * frame.ray[2].xz - ray.xz * ((frame.start[2].y + way * frame.ray[2].y) / ray.y);
    vec2 footprint = sqrt(along_x * along_x + along_y * along_y);

    float cell = frame.plane.y;
    float level = grid_level(length(footprint), cell, frame.plane.z);
    int finest = int(level);
    float fade = level - float(finest);
    float lines[3];
    for (int k = 0; k < 3; ++k) {
        int at = finest + k;
        lines[k] = grid_lines(frame.eye[at].xy + place, cell * POWERS[at], footprint);
    }
    // The finest go, the next become the finest, the coarsest are what the next were: nothing jumps where `level` passes a
    // whole number. The most ink counts, so that lines are not darker where they cross.
    float ink = max(max(lines[0] * (1.0 - fade) * THIN, lines[1] * mix(THICK, THIN, fade)), lines[2] * THICK);
    ink *= clamp(1.0 - length(place) / frame.plane.w, 0.0, 1.0);
    out_color = vec4(PAPER * (1.0 - ink), 1.0);
}
