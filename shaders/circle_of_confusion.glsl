// How large a point becomes in the picture when it is out of focus: the circle of confusion of a thin lens.
//
// A thin lens of focal length f makes the image of a point at distance z behind itself at z', 1/z + 1/z' = 1/f. The sensor
// is where the distance s is sharp, at v: 1/v = 1/f - 1/s. Light of another point passes the opening, of diameter A, on
// its way to z', so by similar triangles it covers on the sensor a disc of diameter
//
//     c = A |z' - v| / z' = A |1 - v/z'| = A v |1/s - 1/z|
//
// (Potmesil and Chakravarty 1981, "A lens and aperture camera model", eq. 3 to 6, with 1/f put in). It is linear in 1/z,
// and so is a perspective depth: what is near blurs without end, what is far no more than infinity does.

// The radius in pixels by which a difference of 1/metre blurs. `focal_px` is v in pixels, the height of the picture by
// 2 tan(yfov / 2); a sensor of `sensor` metres has `height` pixels. `f_number` is f / A.
float blur_per_diopter(float focal_px, float height, float sensor, float f_number, float per_focus) {
    float v = focal_px * sensor / height;
    float f = v / (1.0 + v * per_focus);  // 1/f = 1/v + 1/s
    return 0.5 * (f / f_number) * focal_px;
}

// The signed radius in pixels: positive behind the focus, negative before it. Distances are given as their inverses.
float circle_of_confusion(float per_distance, float per_focus, float blur, float largest) {
    return clamp(blur * (per_focus - per_distance), -largest, largest);
}

// How much of a pixel with this radius is taken from the blurred picture, which has half as many pixels to a side: none
// up to a circle as wide as a pixel, all from where the smaller picture shows it as well.
float blurred_part(float radius) {
    return clamp((abs(radius) - 0.5) / 1.5, 0.0, 1.0);
}
