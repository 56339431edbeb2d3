// Study bias-explorer: the planes and the depth of their maps, and how much light reaches a point below one of the biases.

struct Plane {
    vec4 tilt;   // cosine, sine, tangent, constant bias
    vec4 along;  // direction of the tilt in the map, slope bias
};
layout(BIND(0, 0, 0), std430) readonly buffer Planes_ { Plane planes[]; };
layout(BIND(0, 1, 1), std430) ACCESS buffer Map_ { float map[]; };

const int WIDTH = SIDE + 2 * MARGIN;

// Where a texel of a plane's map is; `texel` counts from the cell's lower left corner and may lie in the margin.
int place_of(int plane, ivec2 texel) {
    return (plane * WIDTH + texel.y + MARGIN) * WIDTH + texel.x + MARGIN;
}

// The distance between plane and sheet, perpendicular to the plane.
float height_of(float y) {
    return max(y, 0.0) * (HEIGHT / float(SIDE));
}
