// Each pixel is lit where the last picture had an edge, where the surfaces of this frame differ within a block, and in each
// eighth frame: a block shows no gradient of its own, so a mask from lit pictures alone would keep it for ever.
//
// If nothing changes, one frame is lit at each pixel, and the mask of its edges is kept (model.py).

layout(constant_id = 0) const int STILL = 0;  // frames without a change

// Whether a pixel shows another surface than the pixel that is lit for it.
bool differs(ivec2 pixel, ivec2 lit) {
    float d = texelFetch(depth, pixel, 0).r, lit_depth = texelFetch(depth, lit, 0).r;
    if (d == 0.0 || lit_depth == 0.0) {
        return d != lit_depth;
    }
    vec3 change = abs(sqrt(found_color(gbuffer_base_color, pixel)) - sqrt(found_color(gbuffer_base_color, lit)));
    vec3 n = normalize(found_normal(gbuffer_normal, pixel)), lit_normal = normalize(found_normal(gbuffer_normal, lit));
    vec4 material = texelFetch(gbuffer_material, pixel, 0), lit_material = texelFetch(gbuffer_material, lit, 0);
    bool alike = max(change.r, max(change.g, change.b)) <= SURFACE && abs(material.g - lit_material.g) <= SURFACE
        && abs(material.b - lit_material.b) <= SURFACE && material.a == lit_material.a
        && (material.a <= 0.5 || dot(n, lit_normal) >= 1.0 - 0.5 * SURFACE)
        && abs(d - lit_depth) <= 0.2 * SURFACE * max(d, lit_depth);
    return !alike;
}

// The turns of neighbours are apart, so the work of a frame is even.
bool has_its_turn(ivec2 texel) {
    return ((uint(texel.x) * 3u + uint(texel.y) * 5u + frame.frame_index) & 7u) == 0u;
}

bool needs_all(ivec2 texel, ivec2 pixel, ivec2 lit) {
    bool known = (frame.valid_histories & HISTORY_RATES) != 0u, before = texelFetch(rates_before, texel, 0).r == 0u;
    if (!known || STILL == WHOLE || STILL == KEPT) {
        return !known || STILL == WHOLE || before;
    }
    return before || (STILL < WHOLE && has_its_turn(texel)) || differs(pixel, lit);
}
