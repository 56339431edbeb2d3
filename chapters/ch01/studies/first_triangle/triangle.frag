// Study first-triangle, fragments: run once for each pixel whose centre lies in the triangle.

// Not the colour of any corner: the GPU has mixed the three, each weighted by how near the pixel is to it (barycentric
// coordinates). Location 0 here is location 0 there; names do not matter.
layout(location = 0) in vec3 in_color;
layout(location = 0) out vec4 out_color;

void main() {
    out_color = vec4(in_color, 1.0);
}
