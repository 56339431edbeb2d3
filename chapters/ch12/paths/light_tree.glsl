// One of many lights, drawn by a tree of their places (light_tree.py): at each node the path goes to the half from which more
// light can come, by power and distance. A half that cannot reach the place is never drawn.

// Power over the square of the distance. 0 only where no light of the node adds anything: beyond the reach of each, or with all
// of them behind the plane of `normal`, which is 0 where light counts from everywhere.
float light_importance(uint node, vec3 position, vec3 normal) {
    uint at = path.tree.x + 2u * node;
    vec4 low = uintBitsToFloat(path_tables[at]), high = uintBitsToFloat(path_tables[at + 1u]);
    vec3 outside = max(max(low.xyz - position, position - high.xyz), vec3(0.0));
    vec3 away = 0.5 * low.xyz + 0.5 * high.xyz - position, half_size = 0.5 * high.xyz - 0.5 * low.xyz;
    float above = dot(away, normal) + dot(half_size, abs(normal));
    vec3 sizes = abs(low.xyz) + abs(high.xyz) + abs(position);
    bool behind = above < -1e-5 * (sizes.x + sizes.y + sizes.z);  // by more than rounding
    if (behind || dot(outside, outside) > high.w) {
        return 0.0;
    }
    float per = 1.0 / frame.eye.w;  // in lengths of the scene, which are neither too large nor too small
    float distance2 = max(dot(away * per, away * per), dot(half_size * per, half_size * per));
    return low.w / clamp(distance2, 1e-12, 1e12);
}

// The number of a light and the probability of drawing it; NO_LIGHT where none reaches the place.
uint drawn_light(vec3 position, vec3 normal, inout uint state, out float probability) {
    uint node = 1u;
    probability = 1.0;
    for (uint width = path.tree.y; width > 1u; width >>= 1u) {
        float left = light_importance(2u * node, position, normal);
        float right = light_importance(2u * node + 1u, position, normal);
        float sum = left + right;
        if (sum <= 0.0) {
            return NO_LIGHT;
        }
        bool goes_right = right > 0.0 && pcg_float(state) * sum >= left;
        probability *= (goes_right ? right : left) / sum;
        node = 2u * node + uint(goes_right);
    }
    uint leaf = node - path.tree.y;
    return path_tables[path.tree.z + (leaf >> 2u)][leaf & 3u];
}
