// Luminance of a linear colour with sRGB primaries (ITU-R BT.709): the second row of the matrix to CIE XYZ.

float luminance(vec3 color) {
    return dot(color, vec3(0.2126, 0.7152, 0.0722));
}
