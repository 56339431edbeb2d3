// The fixed point of places inside of a bin: how many steps a bin has. A bin that holds all pixels of a picture must not
// overflow 32 bits: 2^24 pixels times 256, or 2^30 pixels times 4.
uint place_steps() {
#ifdef ENLARGED  // sides of the picture at most, in sides of what is drawn
    ivec2 size = ENLARGED * ivec2(frame.size.xy);
#else
    ivec2 size = ivec2(frame.size.xy);
#endif
    return size.x <= (1 << 24) / size.y ? 256u : 4u;
}
