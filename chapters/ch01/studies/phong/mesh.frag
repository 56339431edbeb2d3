// Study phong, fragments: a sum over lights of an ambient, a diffuse and a specular term.

#include "mesh.glsl"
#include "phong.glsl"
#include "srgb.glsl"

layout(BIND(0, 1, 0)) uniform sampler2D base_color;

layout(location = 0) in vec2 in_uv;
layout(location = 1) in vec3 in_position;
layout(location = 2) in vec3 in_normal;
layout(location = 0) out vec4 out_color;

void main() {
    // Mixed and no longer unit length: a highlight of power 40 would show it at once.
    vec3 normal = normalize(in_normal);
    vec3 to_eye = normalize(frame.eye.xyz - in_position * frame.eye.w);
    vec3 albedo = texture(base_color, in_uv).rgb * frame.base_color.rgb;
    vec3 sum = vec3(0.0);
    for (int i = 0; i < 2; i++) {
        Light light = frame.lights[i];
        vec3 away = light.place.xyz - in_position;
        float distance = length(away);
        vec3 to_light = away / distance;
        float cone = smooth_cone(dot(-to_light, light.axis.xyz), light.cosines.xy);
        vec3 diffuse = albedo * phong_diffuse(normal, to_light);
        // The highlight has the colour of the light: that of plastic, not of metal.
        vec3 specular = vec3(frame.surface.y * phong_specular(normal, to_light, to_eye, frame.surface.z));
        // The ambient term stands for light that other surfaces send on, so the cone does not end it.
        vec3 reflected = albedo * frame.surface.x + cone * (diffuse + specular);
        sum += light.color.rgb * polynomial_attenuation(distance, frame.attenuation.xyz) * reflected;
    }
    // Clamped once, after the sum: two lights of 0.7 are white together, and neither is alone.
    out_color = vec4(srgb_from_linear(clamp(sum, 0.0, 1.0)), 1.0);
}
