// Study reflection-refraction: Snell's law, Schlick's share, and a ray through a ball.
//
// `n` is the unit normal on the side where the light comes from, `d` the unit direction in which it travels: dot(n, d) < 0.

// The part that is mirrored when light meets a surface at right angles; eta is the index here over the index beyond.
// It is Fresnel's formula there, and the same from both sides.
float mirrored_at_normal(float eta) {
    float root = (1.0 - eta) / (1.0 + eta);
    return root * root;
}

// The part that is mirrored at any angle (C. Schlick 1994). `cosine` is that of the angle to the normal: 0 grazes, and then
// everything is mirrored. The sign is worth a thought: with 1 + cosine in place of 1 - cosine, "parts" reach 31.
float schlick_share(float eta, float cosine) {
    float f0 = mirrored_at_normal(eta);
    float m = clamp(1.0 - cosine, 0.0, 1.0);
    float m2 = m * m;
    return f0 + (1.0 - f0) * (m2 * m2 * m);
}

vec3 mirrored_ray(vec3 d, vec3 n) {
    return d - 2.0 * dot(n, d) * n;
}

// Snell: the part of the direction along the surface is multiplied by eta, and what is left for the normal makes it unit
// length. Nothing is left beyond the critical angle, where all light is mirrored: (0, 0, 0). This is GLSL's `refract`.
vec3 bent_ray(vec3 d, vec3 n, float eta) {
    float cosine = dot(n, d);
    float k = 1.0 - eta * eta * (1.0 - cosine * cosine);
    return k < 0.0 ? vec3(0.0) : eta * d - (eta * cosine + sqrt(k)) * n;
}

// The direction in which a ray leaves a ball that it entered in direction `inside` where the normal was `n`. It meets the
// other side at the angle at which it left this one: in a ball nothing is trapped.
vec3 leaving_ray(vec3 inside, vec3 n, float index) {
    vec3 beyond = n - 2.0 * dot(n, inside) * inside;  // the normal where the ray comes out: the chord's other end
    return bent_ray(inside, -beyond, index);
}
