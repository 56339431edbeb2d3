// Texture coordinates as they would be without jitter, for fragment shaders. Geometry is moved to make edges smooth, while
// a texture that is filtered by its levels needs no movement.
//
// The picture is moved right and down by `jitter_px`, so pixel p has the coordinates of the steady picture's p - jitter.
// Those at p itself are a step of the jitter further on. Rows go down in both APIs, and so does dFdyFine.
vec2 unjittered(vec2 uv, vec2 jitter_px) {
    return uv + dFdxFine(uv) * jitter_px.x + dFdyFine(uv) * jitter_px.y;
}
