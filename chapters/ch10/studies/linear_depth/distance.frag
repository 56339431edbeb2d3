// Study linear-depth, fragments: the distance along the axis as interpolated, before anything rounds it to a depth.

layout(location = 0) out float out_distance;

void main() {
    out_distance = 1.0 / gl_FragCoord.w;
}
