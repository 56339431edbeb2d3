// Study burley-smith, fragments: a chart of balls, each seen from infinitely far, in the light of a sun and of a sky.

#include "burley.glsl"
#include "environment.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    vec4 base_color;  // w: lux of the sun
    vec4 sun;         // its direction; w: part of the sky
    vec4 balls;       // number along x and y; z, w: size of a cell by its shorter side
} frame;

layout(BIND(0, 1, 0)) uniform sampler2D panorama;  // irradiance / pi

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec2 place = in_uv * frame.balls.xy;
    vec2 ball = floor(place);
    vec2 p = (fract(place) * 2.0 - 1.0) * frame.balls.zw / 0.9;
    float inside = 1.0 - dot(p, p);
    vec3 light = vec3(0.01);
    if (inside > 0.0) {
        vec3 n = vec3(p.x, -p.y, sqrt(inside));
        Surface surface = surface_of(frame.base_color.rgb, ball.y, ball.x / (frame.balls.x - 1.0));
        light = frame.base_color.w * burley_smith(surface, n, frame.sun.xyz, vec3(0.0, 0.0, 1.0));
        light += frame.sun.w * environment_diffuse(surface, textureLod(panorama, panorama_uv(n), 0.0).rgb);
    }
    out_color = vec4(srgb_from_linear(clamp(light, 0.0, 1.0)), 1.0);
}
