// Study timeline-or-fences, fragments: each number of the field as a grey.

layout(BIND(0, 0, 0), std430) readonly buffer Field_ {
    uint field[];
};

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    uvec2 cell = min(uvec2(in_uv * float(CELLS)), uvec2(CELLS - 1));
    out_color = vec4(vec3(float(field[cell.y * uint(CELLS) + cell.x]) / 255.0), 1.0);
}
