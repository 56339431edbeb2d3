// Study rotating-cube, fragments: the colour as it arrives.

// Mixed with perspective: a point halfway along an edge gets the colour halfway, though it is not halfway in the picture.
layout(location = 0) in vec3 in_color;
layout(location = 0) out vec4 out_color;

void main() {
    out_color = vec4(in_color, 1.0);
}
