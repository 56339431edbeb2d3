// One ray for each pixel of a study that fills the picture: `full_screen.py` writes what it is made from.

struct Rays {
    vec4 origin[3];     // at the middle of the picture, and what x and y add to it, each from -1 to 1
    vec4 direction[3];  // likewise
};

// `uv` is from 0 to 1 with row 0 on top, as `fullscreen.vert` gives it. `direction` has any length.
void ray_at(Rays rays, vec2 uv, out vec3 origin, out vec3 direction) {
    vec2 p = uv * 2.0 - 1.0;
    origin = rays.origin[0].xyz + rays.origin[1].xyz * p.x + rays.origin[2].xyz * p.y;
    direction = rays.direction[0].xyz + rays.direction[1].xyz * p.x + rays.direction[2].xyz * p.y;
}
