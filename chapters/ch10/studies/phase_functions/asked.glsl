// Study phase-functions: the direction in which light arrives, and the eight anisotropies.

struct Asked {
    vec4 arriving;
    vec4 size;  // xy: of the picture in pixels
    vec4 g[2];
};
PUSH(Asked, asked)

float g_of(uint lobe) { return asked.g[lobe >> 2u][lobe & 3u]; }
