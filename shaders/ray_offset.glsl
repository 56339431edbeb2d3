vec3 offset_from(vec3 p, vec3 n) { return p + n * 1e-4 * max(1.0, max(abs(p.x), max(abs(p.y), abs(p.z)))); }
