// Study one-light, fragments: how much light arrives, and how much of it goes on to the eye.

#include "mesh.glsl"
#include "srgb.glsl"

const float PI = 3.14159265358979;

layout(BIND(0, 1, 0)) uniform sampler2D base_color;

layout(location = 0) in vec2 in_uv;
layout(location = 1) in vec3 in_position;
layout(location = 2) in vec3 in_normal;
layout(location = 0) out vec4 out_color;

void main() {
    // Between three unit vectors the mixture is shorter than 1.
    vec3 normal = normalize(in_normal);
    vec3 to_lamp = frame.lamp.xyz - in_position;
    float distance2 = dot(to_lamp, to_lamp);
    // A lamp's light spreads over a sphere, whose surface grows with the square of its radius; and a surface that is
    // turned away by an angle catches only the cosine of it (J. H. Lambert 1760). Behind the horizon there is none.
    float cosine = max(dot(normal, to_lamp) * inversesqrt(distance2), 0.0);
    vec3 illuminance = frame.intensity.rgb * (cosine / distance2);
    // The base colour says which part is reflected. A matt surface sends it evenly over the hemisphere, and the integral
    // of the cosine over that is pi: a white surface under pi lux has a luminance of 1.
    vec3 albedo = texture(base_color, in_uv).rgb * frame.base_color.rgb;
    vec3 luminance = albedo / PI * illuminance;
    // All of it is light until here; this line alone makes a picture. The chapter gives it a pass of its own.
    out_color = vec4(srgb_from_linear(clamp(luminance, 0.0, 1.0)), 1.0);
}
