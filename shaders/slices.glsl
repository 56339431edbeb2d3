// Froxels: a grid of a view's frustum, its slices of depth in a constant ratio, so that a froxel keeps its shape.
//
// Slice s of `count` ends at the depth near * (far / near)^((s + 1) / count) in metres along the view's axis. The first
// begins at the eye. Coordinates uvw of a volume are 0 to 1, v downwards; w counts slices. `octaves` is
// log2(far / near), which the CPU computes. Depth is a view's own, not that of a depth buffer, so near and far of the
// grid need not be those of the camera.

float slice_depth(float w, float near, float octaves) {
    return near * exp2(w * octaves);
}

// The inverse: below 0 in front of `near`, which the first slice covers too. Depths at or behind the eye give -1.
float slice_coordinate(float depth, float near, float octaves) {
    return depth > 0.0 ? max(log2(depth / near) / octaves, -1.0) : -1.0;
}

// The depth at which slice `index` begins.
float slice_begin(uint index, uint count, float near, float octaves) {
    return index == 0u ? 0.0 : slice_depth(float(index) / float(count), near, octaves);
}

// The depth a part (0 to 1) of the way through slice `index`, where it takes its sample: by ratio, but for the first,
// which begins at the eye.
float slice_sample(uint index, float part, uint count, float near, float octaves) {
    float depth = slice_depth((float(index) + (index == 0u ? 1.0 : part)) / float(count), near, octaves);
    return index == 0u ? part * depth : depth;
}

// The point of view space at uv and a depth in metres, for perspective and orthographic views, with jitter or without.
// `clip_from_view` has its scales on the diagonal and, in its third and fourth columns, what shifts the picture.
vec3 view_from_volume(vec2 uv, float depth, mat4 clip_from_view) {
    float w = clip_from_view[3][3] - clip_from_view[2][3] * depth;
    vec2 shift = clip_from_view[3].xy - clip_from_view[2].xy * depth;
    vec2 scale = vec2(clip_from_view[0][0], clip_from_view[1][1]);
    return vec3(((uv * 2.0 - 1.0) * w - shift) / scale, -depth);
}

// uv and depth in metres of a point of view space: w of clip space is a depth for perspective views alone.
vec3 volume_from_view(vec3 view, mat4 clip_from_view) {
    float w = clip_from_view[3][3] + clip_from_view[2][3] * view.z;
    vec2 shift = clip_from_view[3].xy + clip_from_view[2].xy * view.z;
    vec2 scale = vec2(clip_from_view[0][0], clip_from_view[1][1]);
    return vec3((view.xy * scale + shift) / w * 0.5 + 0.5, -view.z);
}

// Metres along the ray through uv for a metre of depth: 1 on a perspective view's axis, 1 everywhere in an
// orthographic one.
float ray_stretch(vec2 uv, mat4 clip_from_view) {
    return length(view_from_volume(uv, 1.0, clip_from_view) - view_from_volume(uv, 0.0, clip_from_view));
}
