// Studies of meshlets, fragments of the second pass: the number of the instance plus one, so that 0 is the background.

layout(location = 1) flat in uint in_instance;
layout(location = 0) out uint out_id;

void main() {
    out_id = in_instance + 1u;
}
