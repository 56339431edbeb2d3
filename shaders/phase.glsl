// The phase function of Henyey and Greenstein (1941): where a particle sends the light that it scatters, per steradian.
//
// The usual denominator, 1 + g^2 - 2 g cos, cancels near the peak. Written as (1 - g)^2 + 2 g (1 - cos) it is a sum of
// numbers that are not negative, and 1 - cos of two directions does not cancel either. The same in float64, and what it
// integrates to: tests/twins/fog.py.

// `one_minus_cosine` is that of the angle by which light is turned, 0 to 2; `g`, the mean cosine, lies in -0.99 to 0.99.
float henyey_greenstein(float one_minus_cosine, float g) {
    float size = abs(g);
    float turned = g < 0.0 ? 2.0 - one_minus_cosine : one_minus_cosine;
    float narrow = 1.0 - size;
    float d = narrow * narrow + 2.0 * size * turned;
    return narrow * (1.0 + size) / (12.566370614 * d * sqrt(d));
}

// 1 - cos between unit vectors: the direction in which light arrives, and that in which it leaves for the eye.
float one_minus_cosine(vec3 arriving, vec3 leaving) {
    vec3 apart = arriving - leaving;
    return 0.5 * dot(apart, apart);
}
