// Study textured-quads: what a depth buffer holds, as a distance.

// Distance over `far`, at most 1. Reversed z: depth is near / distance, and 0 is the sky, which has no distance.
float shown_depth(float depth, float near, float far) {
    if (depth <= 0.0) return 1.0;
    return min(near / (depth * far), 1.0);
}
