// The exposure of a frame, from a block of the frame's slot. The CPU writes `of_view`. If the GPU finds the exposure, the
// kernel of the frame before wrote `adapted` (adapt.comp), and the CPU neither writes nor reads it.

layout(BIND(0, 10, 2), std140) uniform Exposure_ {
    vec4 of_view;  // x: exposure of the frame's view, y: of the frame before's, z: 1 if `adapted` counts, else 0
    vec4 adapted;  // x: exposure of this frame, y: of the frame before, z: the state of adaptation (adapt.comp)
} exposed;

// The factor from nits to picture values, in this frame.
float exposure() {
    return exposed.of_view.z != 0.0 ? exposed.adapted.x : exposed.of_view.x;
}

// The factor of the frame before: a history is multiplied by exposure() / previous_exposure().
float previous_exposure() {
    return exposed.of_view.z != 0.0 ? exposed.adapted.y : exposed.of_view.y;
}
