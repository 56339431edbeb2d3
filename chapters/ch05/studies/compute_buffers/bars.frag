// Study compute-buffers, fragments: a bar for each number, x before y.

layout(BIND(0, 0, 0), std430) readonly buffer Input_ {
    uint x[];
};
layout(BIND(0, 1, 1), std430) readonly buffer Output_ {
    uint y[];
};

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    uint i = min(uint(in_uv.x * float(COUNT)), uint(COUNT - 1));
    float height = (1.0 - in_uv.y) * float(TOP);
    vec3 color = vec3(0.05, 0.05, 0.06);
    if (height < float(y[i])) {
        color = vec3(0.1, 0.45, 0.55);
    }
    if (height < float(x[i])) {
        color = vec3(0.95, 0.75, 0.3);
    }
    out_color = vec4(color, 1.0);
}
