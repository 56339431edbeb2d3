// Tone curves that work on each channel alone: bright colours lose their saturation on the way to white.

// Reinhard's curve with a white point: c (1 + c / w^2) / (1 + c). The value `white` and all above it become 1.
// Source: Reinhard, Stark, Shirley and Ferwerda 2002, "Photographic Tone Reproduction for Digital Images", equation 4.
vec3 tone_reinhard(vec3 color, float white) {
    vec3 c = min(color, white);
    return min(c * (1.0 + c / (white * white)) / (1.0 + c), 1.0);
}

// A rational fit of the ACES reference rendering and output transforms for displays of 100 nits.
// Source: Narkowicz 2015, "ACES Filmic Tone Mapping Curve".
vec3 tone_aces(vec3 color) {
    return clamp((color * (2.51 * color + 0.03)) / (color * (2.43 * color + 0.59) + 0.14), 0.0, 1.0);
}
