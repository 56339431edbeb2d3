// Study first-triangle, vertices: run once per corner, it says where that corner is in the picture.

// There is no vertex buffer yet: the number of the corner picks from these. x from -1 (left) to 1, y from -1 (bottom) to 1.
const vec2 PLACES[3] = vec2[](vec2(-0.6, -0.4), vec2(0.6, -0.4), vec2(0.0, 0.6));
const vec3 COLORS[3] = vec3[](vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));

layout(location = 0) out vec3 out_color;

void main() {
    vec2 place = PLACES[VERTEX_ID];
    // Row 0 of a picture is its top, and y = -1 is row 0. So what points up in the numbers above is turned around.
    // The third number is depth, which nothing looks at yet; the fourth is what perspective divides by.
    gl_Position = vec4(place.x, -place.y, 0.0, 1.0);
    out_color = COLORS[VERTEX_ID];
}
