// The light of a pixel in picture values; false if the pixel shows the background alone, whose grey is given in picture
// values: as light of the scene it would follow the exposure, and drive it away. Before solid surfaces alpha is what
// blended ones let through of the light behind them, so it tells how much of the grey a pixel without depth shows.
bool measured_light(ivec2 pixel, out vec3 light) {
    vec4 color = texelFetch(color_hdr, pixel, 0);
    light = color.rgb;
#ifdef SKIP_EMPTY
    if (texelFetch(depth, pixel, 0).r == 0.0) {
        light -= BACKGROUND * color.a;
        return color.a < 1.0;
    }
#endif
    return true;
}
