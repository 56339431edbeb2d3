// Punctual lights in glTF's units (KHR_lights_punctual): candela and lux in, radiance-free illuminance at a point out.
//
// A light's record holds what does not change over the surface: colour is intensity times exposure, `inverse_range2` is
// 0 for an unlimited range, `end_distance2` is where the setting `light_cutoff` ends the light (huge if it does not).

const uint LIGHT_POINT = 0u;
const uint LIGHT_SPOT = 1u;
const uint LIGHT_DIRECTIONAL = 2u;

struct Light {
    vec3 position;         // relative to the scene's origin
    uint kind;
    vec3 direction;        // in which the light travels
    float inverse_range2;
    vec3 color;            // pre-exposed candela or lux
    float end_distance2;
    vec4 cone;             // x, y: scale and offset of the cosine
};

// The window by which glTF takes a light to zero at its range: clamp(1 - (d/range)^4, 0, 1).
float range_window(float distance2, float inverse_range2) {
    float x = distance2 * inverse_range2;
    return clamp(1.0 - x * x, 0.0, 1.0);
}

// Returns the illuminance of a surface that faces the light, and the direction towards it.
// `smallest2` is the square of a length below which distances are not told apart: 1/d^2 stays finite.
vec3 illuminance(Light light, vec3 position, float smallest2, out vec3 to_light) {
    if (light.kind == LIGHT_DIRECTIONAL) {
        to_light = -light.direction;
        return light.color;
    }
    vec3 offset = light.position - position;
    float distance2 = max(dot(offset, offset), smallest2);
    to_light = offset * inversesqrt(distance2);
    float falloff = range_window(distance2, light.inverse_range2) / distance2;
    if (light.kind == LIGHT_SPOT) {
        float cone = clamp(dot(-to_light, light.direction) * light.cone.x + light.cone.y, 0.0, 1.0);
        falloff *= cone * cone;
    }
    return distance2 < light.end_distance2 ? light.color * falloff : vec3(0.0);
}
