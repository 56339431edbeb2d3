// Study vertex-pulling, fragments: uv as a colour, on tiles.

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec2 tile = floor(in_uv * 8.0);
    float dark = mod(tile.x + tile.y, 2.0);
    out_color = vec4(vec3(fract(in_uv), 0.5) * (1.0 - 0.5 * dark), 1.0);
}
