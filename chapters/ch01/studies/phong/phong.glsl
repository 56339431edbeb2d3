// Study phong: the terms of B. T. Phong's reflection model (1975), and how lights of that time fade.
//
// All vectors are unit length and point away from the surface.

float phong_diffuse(vec3 n, vec3 l) {
    return max(dot(n, l), 0.0);
}

// How near the mirrored light comes to the eye. Light from behind has no highlight, though its mirror image may face the eye.
float phong_specular(vec3 n, vec3 l, vec3 v, float shininess) {
    float cosine = dot(reflect(-l, n), v);
    return dot(n, l) > 0.0 && cosine > 0.0 ? pow(cosine, shininess) : 0.0;
}

// Not the inverse square, which is endless close to the light: `terms` are constant, linear and quadratic.
float polynomial_attenuation(float distance, vec3 terms) {
    return 1.0 / (terms.x + distance * (terms.y + distance * terms.z));
}

// 0 where the angle to the axis has this cosine or a smaller one, `cosines.x`; 1 from `cosines.y` on; without a kink between.
float smooth_cone(float cosine, vec2 cosines) {
    return smoothstep(cosines.x, cosines.y, cosine);
}
