// Study reflection-refraction, fragments: a ray meets the ball or not, and each ray that leaves asks the panorama.

#include "../full_screen.glsl"
#include "environment.glsl"
#include "optics.glsl"
#include "srgb.glsl"

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    Rays rays;
    vec4 ball;  // radius, refractive index, surfaces that bend, exposed factor on light
    vec4 show;  // mirrored, bent: 1 or 0
} frame;

layout(BIND(0, 1, 0)) uniform sampler2D panorama;

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

vec3 light_from(vec3 direction) {
    // Level 0, said aloud: at the seam u jumps from 1 to 0, and a sampler that compared neighbours would take that for a
    // thousand texels a pixel.
    return textureLod(panorama, panorama_uv(direction), 0.0).rgb * frame.ball.w;
}

void main() {
    vec3 origin, d;
    ray_at(frame.rays, in_uv, origin, d);
    d = normalize(d);
    // Where |origin + t d| = radius: the nearer root of a quadratic equation, if there is one in front.
    float b = dot(origin, d);
    vec3 closest = origin - b * d;
    float inside = frame.ball.x * frame.ball.x - dot(closest, closest);
    vec3 light;
    if (inside <= 0.0 || b > 0.0) {
        light = light_from(d);
    } else {
        vec3 n = (closest - sqrt(inside) * d) / frame.ball.x;
        float eta = 1.0 / frame.ball.y;
        float share = schlick_share(eta, -dot(n, d));
        vec3 bent = bent_ray(d, n, eta);
        if (frame.ball.z > 1.5) {
            bent = leaving_ray(bent, n, frame.ball.y);
        }
        // The two parts are those of the same light: together they are all of it.
        light = frame.show.x * share * light_from(mirrored_ray(d, n)) + frame.show.y * (1.0 - share) * light_from(bent);
    }
    out_color = vec4(srgb_from_linear(clamp(light, 0.0, 1.0)), 1.0);
}
