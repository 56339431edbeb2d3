// The metallic-roughness BRDF of glTF 2.0, appendix B: GGX distribution, separable Smith visibility, Schlick's Fresnel.
//
// All vectors are unit length and point away from the surface; alpha is roughness squared. A BRDF has the unit 1/sr.

const float PI = 3.14159265358979;

// Below this alpha the peak of D, 1/(pi alpha^2), has nothing left to resolve in float32, and 0 would be 0/0.
const float ALPHA_MIN = 1e-3;

// D = alpha^2 / (pi ((n.h)^2 (alpha^2 - 1) + 1)^2), written with |n x h|^2 + alpha^2 (n.h)^2 in place of the inner sum.
// The two are the same number, since (n.h)^2 + |n x h|^2 = 1. But as printed, the sum takes two numbers near 1 from each
// other: at alpha = 1e-3 float32 then has no correct digit left. The cross product is small without cancellation.
float distribution_ggx(vec3 n, vec3 h, float alpha) {
    float n_dot_h = dot(n, h);
    vec3 n_cross_h = cross(n, h);
    float a = alpha * n_dot_h;
    float k = alpha / (dot(n_cross_h, n_cross_h) + a * a);
    return n_dot_h > 0.0 ? k * k * (1.0 / PI) : 0.0;
}

// G / (4 |n.l| |n.v|), the 4 and the cosines cancelled against the masking terms.
float visibility_ggx(float n_dot_l, float n_dot_v, float alpha) {
    float a2 = alpha * alpha;
    float l = abs(n_dot_l);
    float v = abs(n_dot_v);
    return 1.0 / ((l + sqrt(a2 + (1.0 - a2) * l * l)) * (v + sqrt(a2 + (1.0 - a2) * v * v)));
}

float schlick_weight(float cosine) {
    float m = clamp(1.0 - abs(cosine), 0.0, 1.0);
    float m2 = m * m;
    return m2 * m2 * m;
}

// The whole BRDF times the cosine n.l; zero for light from behind the surface.
vec3 metallic_roughness(vec3 n, vec3 l, vec3 v, vec3 base_color, float metallic, float alpha) {
    float n_dot_l = dot(n, l);
    float n_dot_v = dot(n, v);
    // Half way between opposite vectors there is no direction: such light grazes the surface and carries nothing.
    vec3 sum = l + v;
    float length2 = dot(sum, sum);
    if (n_dot_l <= 0.0 || length2 < 1e-12) {
        return vec3(0.0);
    }
    vec3 h = sum * inversesqrt(length2);
    float weight = schlick_weight(dot(h, v));
    float specular = visibility_ggx(n_dot_l, n_dot_v, alpha) * distribution_ggx(n, h, alpha);
    vec3 diffuse = base_color * (1.0 / PI);
    // Not `mix`: drivers may make a + t (b - a) of it, which at t = 1 leaves the rounding of a. Off its peak a smooth metal
    // reflects a millionth of what the other side holds, and would keep two digits.
    float fresnel = 0.04 + 0.96 * weight;
    vec3 dielectric = diffuse * (1.0 - fresnel) + specular * fresnel;
    vec3 metal = specular * (base_color + (1.0 - base_color) * weight);
    return (dielectric * (1.0 - metallic) + metal * metallic) * n_dot_l;
}
