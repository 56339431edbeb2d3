// Study wireframe: how far a pixel is from the edges of its triangle.

// 0 on an edge, 1 from `thickness` pixels on, and in between the distance to the nearest edge over `thickness`. Each of
// `weights` is 0 along one edge and grows evenly across the picture, so it divided by its slope is a distance in pixels.
// `along_x` and `along_y` say how the weights change from a pixel to its neighbours.
float edge_factor(vec3 weights, vec3 along_x, vec3 along_y, float thickness) {
    vec3 slopes = sqrt(along_x * along_x + along_y * along_y);
    vec3 distances = weights / max(slopes, 1e-20);
    return clamp(min(min(distances.x, distances.y), distances.z) / thickness, 0.0, 1.0);
}
