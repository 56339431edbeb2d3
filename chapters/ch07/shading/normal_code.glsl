// Normals in channels from 0 to 1 of ten bits: 512 of 1023 stands for 0, so that what is upright comes back as it was.

vec3 coded_normal(vec3 n) {
    return (n * 511.0 + 512.0) / 1023.0;
}

vec3 decoded_normal(vec3 code) {
    return (code * 1023.0 - 512.0) / 511.0;
}
