// The part of a colour that is brighter than a threshold, with its hue: the largest channel is reduced by the threshold,
// and the others in proportion. It begins at zero without a step, so a light that crosses the threshold does not flicker.
vec3 bright_part(vec3 color, float threshold) {
    float peak = max(color.r, max(color.g, color.b));
    return peak > threshold ? color * ((peak - threshold) / peak) : vec3(0.0);
}
