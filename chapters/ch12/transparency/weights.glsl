// Weighted blending (McGuire and Bavoil 2013, "Weighted Blended Order-Independent Transparency"): a mean of all layers in
// which near and opaque ones weigh more. It needs no order, and is exact for one layer and for layers of one colour.

// The weight of a layer `ahead` of the camera: equation 9 of the paper, with the scene's length scale in place of its 200.
float layer_weight(float alpha, float ahead, float length_scale) {
    float far = ahead / length_scale, far2 = far * far;
    return alpha * clamp(0.03 / (1e-5 + far2 * far2), 1e-2, 3e3);
}

// The colour of layers over `under`: `sum` has their weighted colours times opacity, and in a the product of 1 - opacity;
// `weights` is the sum of weighted opacities.
vec3 weighted_color(vec4 sum, float weights, vec3 under) {
    vec3 mean = weights > 0.0 ? sum.rgb / weights : vec3(0.0);
    return mean * (1.0 - sum.a) + under * sum.a;
}
