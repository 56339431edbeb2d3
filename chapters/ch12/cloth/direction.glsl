// Returns the direction of a vector of any length, or `otherwise` if it has none.
//
// The vector is first divided by its largest component: squares of small areas would vanish, and axes stay exact.
vec3 direction(vec3 v, vec3 otherwise) {
    vec3 size = abs(v);
    float largest = max(size.x, max(size.y, size.z));
    if (!(largest > 1e-30)) {
        return otherwise;
    }
    vec3 u = v / largest;
    u = vec3(
        size.x == largest ? sign(v.x) : u.x, size.y == largest ? sign(v.y) : u.y, size.z == largest ? sign(v.z) : u.z
    );
    float squared = dot3(u, u);
    return squared == 1.0 ? u : u / sqrt(squared);
}
