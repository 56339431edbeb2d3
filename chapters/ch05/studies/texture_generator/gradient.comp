// Study texture-generator, a shader: the number of the column in red, that of the row in green.
#include "toy.glsl"

void mainImage(out vec4 fragColor, in vec2 fragCoord) {
    // Without the half: column x of w becomes x / w, and is stored as 255 x / w, rounded.
    fragColor = vec4((fragCoord - 0.5) / iResolution.xy, 0.0, 1.0);
}
