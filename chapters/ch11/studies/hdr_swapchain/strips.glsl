// Study hdr-swapchain: the strips of the scene, from the top, and the stops along them.

const vec3 STRIP_COLORS[STRIPS] = vec3[](
    vec3(1.0), vec3(1.0, 0.5, 0.15), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));

// Stops (factors of two) above paper white at a place across the picture, 0 to 1.
float stops_at(float across) { return mix(-float(STOPS), float(STOPS), across); }
