// Study edited-draws, fragments of the second pass: a number plus one, so that 0 is the background.

layout(location = 2) flat in uint in_number;
layout(location = 0) out uint out_id;

void main() {
    out_id = in_number + 1u;
}
