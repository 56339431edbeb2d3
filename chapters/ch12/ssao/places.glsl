// Distances and places of what is seen, from its depth; depth 0 is the sky, which has none.

#include "scene/scene.glsl"
#include "ambient_occlusion.glsl"

// Metres ahead of the eye. The depth of any projection decides them alone: equal depths give equal distances.
float distance_of(float d) {
    vec2 zw = frame.view_from_clip[2].zw * d + frame.view_from_clip[3].zw;
    return -zw.x / zw.y;
}

// The place in view space of the middle of `pixel` at depth `d`.
vec3 place_of(ivec2 pixel, float d) {
    vec2 ndc = (vec2(pixel) + 0.5) * (2.0 * frame.size.zw) - 1.0;
    vec4 in_view = frame.view_from_clip * vec4(ndc, d, 1.0);
    return in_view.xyz / in_view.w;
}

// Where in the picture, in pixels, a place of view space is seen. Behind the eye it is outside of the picture.
vec2 seen_at(vec3 place) {
    vec4 clip = frame.clip_from_view * vec4(place, 1.0);
    return clip.w > 0.0 ? (clip.xy / clip.w * 0.5 + 0.5) * frame.size.xy : vec2(-1.0);
}
