// Second step of depth of field: every point becomes its disc.
//
// Discs are not drawn but found: each pixel looks around and asks which of the points there have a disc that reaches it.
// A point's light is shared out evenly over its disc, so it counts with 1 / (pi r^2). What is sharp has no disc, and so
// does not bleed; what lies before the focus covers what is behind it, and so is kept apart, with the part of the pixel
// that it covers.
//
// A disc of up to TAPS pixels of this half-size picture is summed pixel by pixel; larger ones by as many samples.

#include "circle_of_confusion.glsl"

const float PI = 3.14159265358979;

layout(BIND(0, 0, 3)) uniform sampler2D dof_half;
layout(BIND(0, 1, 4)) uniform sampler2D dof_part;

layout(location = 0) out vec4 out_far;   // rgb: light of what lies in the focus or behind it, a: the pixel's own radius
layout(location = 1) out vec4 out_near;  // rgb: light of what lies before the focus, a: the part that it covers

// How much of a pixel at this distance a disc covers, and which part of a point's light it then gets. Lengths are in
// pixels of the half-size picture; the rim is a pixel wide, whose square is the 1/12.
float share(float radius, float distance) {
    return clamp(radius - distance + 0.5, 0.0, 1.0) / (PI * (radius * radius + 1.0 / 12.0));
}

// Beyond the picture lies more of what is at its rim.
vec4 tap(ivec2 pixel, ivec2 last) {
    return texelFetch(dof_half, clamp(pixel, ivec2(0), last), 0);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(dof_half, 0) - 1;
    vec4 own = tap(pixel, last);
    float own_radius = 0.5 * abs(own.a);

    // How far anything is that reaches this pixel: its own disc, or one of something before the focus.
    float largest = LARGEST_RADIUS * float(last.y + 1);
    float spacing = max(1.0, largest / float(TAPS));
    int taps = int(min(float(TAPS), largest) + 0.5);
    float reach = own_radius;
    for (int y = -taps; y <= taps; y += 2) {
        for (int x = -taps; x <= taps; x += 2) {
            // Four neighbours at a time, in the order in which they are gathered around the corner that they share.
            vec2 offset = round(vec2(x, y) * spacing);
            vec4 radii = -0.5 * textureGather(dof_half, (vec2(pixel) + offset + 1.0) / vec2(last + 1), 3);
            vec4 right = offset.x + vec4(0.0, 1.0, 1.0, 0.0);
            vec4 down = offset.y + vec4(1.0, 1.0, 0.0, 0.0);
            vec4 distances = sqrt(right * right + down * down);
            vec4 reached = mix(vec4(0.0), distances, greaterThan(radii + 0.5, distances));
            reach = max(reach, max(max(reached.x, reached.y), max(reached.z, reached.w)));
        }
    }

    vec4 far = vec4(0.0);
    vec4 near = vec4(0.0);
    spacing = max(1.0, reach / float(TAPS));
    taps = int(ceil(min(float(TAPS), reach + 0.5)));
    for (int y = -taps; y <= taps; ++y) {
        for (int x = -taps; x <= taps; ++x) {
            ivec2 offset = ivec2(round(vec2(x, y) * spacing));
            float distance = length(vec2(offset));
            vec4 found = tap(pixel + offset, last);
            float radius = 0.5 * abs(found.a);
            if (found.a < -0.5) {  // what is sharp may be a rounding before the focus
                float part = texelFetch(dof_part, clamp(pixel + offset, ivec2(0), last), 0).r;
                near += part * blurred_part(found.a) * share(radius, distance) * vec4(found.rgb, 1.0);
            } else {
                // This pixel's surface hides part of a disc that lies farther away; behind one that is transparent at its
                // rim, since it is before the focus, what is seen is guessed from around.
                radius = own.a < -0.5 ? max(radius, own_radius) : min(radius, own_radius);
                far += share(radius, distance) * vec4(found.rgb, 1.0);
            }
        }
    }
    out_far = vec4(far.a > 0.0 ? far.rgb / far.a : own.rgb, own.a);
    out_near = near.a > 0.0 ? vec4(near.rgb / near.a, min(near.a * spacing * spacing, 1.0)) : vec4(0.0);
}
