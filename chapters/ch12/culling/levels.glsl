// The choice of a level of detail by its error in the picture.

#ifdef LEVELS
// How many pixels a point in a sphere moves at most when it moves by 1 m. A perspective view takes p to f p.xy / -p.z,
// where f is the focal length in pixels. The derivative of that has the norm f |p| / p.z^2. In the view |p| / -p.z is
// largest in a corner, and in the sphere -p.z is smallest at its near side. There is no bound if that is behind the eye.
float pixels_per_metre(Bounds bounds) {
    vec2 stretch = abs(vec2(view.clip_from_view[0].x, view.clip_from_view[1].y));
    vec2 focal = 0.5 * stretch * view.size.xy;
    float most = max(focal.x, focal.y);
    if (view.orthographic != 0u) {
        return most;
    }
    float corner = length(vec3((1.0 + abs(view.clip_from_view[2].xy)) / stretch, 1.0));
    float nearest = -bounds.centre_view.z - bounds.radius;
    return nearest > 0.0 ? most * corner / nearest : 1e30;
}

// The coarsest level whose error is allowed; errors are in units of what is allowed in the picture, and never fall.
uint level_in_view(Draw draw, Instance instance) {
    uint further = coarser_levels(draw), level = 0u;
    if (further > 0u) {
        float scale = pixels_per_metre(bounds_of_instance(instance)) * stretch_bound(instance.world_from_object);
        for (uint number = 0u; number < further; ++number) {
            float error = uintBitsToFloat(draws[sizes.counts.x + first_level(draw) + number].first_bit);
            level += error * scale <= 1.0 ? 1u : 0u;
        }
    }
    return level;
}
#endif
