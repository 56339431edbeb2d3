// A tangent frame without stored tangents (Schueler, "Followup: Normal Mapping Without Precomputed Tangents", 2013).
//
// dp and duv are the changes of position and uv from pixel to pixel, along x and y. In the plane across the normal n, the
// gradient of u is the vector T with T . dp_x = du_x and T . dp_y = du_y. The vectors cross(dp_y, n) and cross(n, dp_x)
// are orthogonal to dp_y and dp_x, and so T is proportional to cross(dp_y, n) du_x + cross(n, dp_x) du_y.

struct Frame3 {
    vec3 tangent;    // unit length, along the gradient of u in the surface; 0 where there is none
    vec3 bitangent;  // cross(normal, tangent), in the direction in which v grows
};

Frame3 cotangent_frame(vec3 n, vec3 dp_x, vec3 dp_y, vec2 duv_x, vec2 duv_y) {
    vec3 across_y = cross(dp_y, n), across_x = cross(n, dp_x);
    // The sign of the projected area: a surface seen from behind, or a mirrored picture, turns both vectors around.
    float turned = dot(cross(dp_x, dp_y), n) < 0.0 ? -1.0 : 1.0;
    vec3 t = turned * (across_y * duv_x.x + across_x * duv_y.x);
    vec3 v = turned * (across_y * duv_x.y + across_x * duv_y.y);
    float largest = max(abs(t.x), max(abs(t.y), abs(t.z)));
    if (!(largest > 0.0)) {
        return Frame3(vec3(0.0), vec3(0.0));
    }
    t = normalize(t / largest);
    vec3 b = cross(n, t);
    return Frame3(t, dot(b, v) < 0.0 ? -b : b);
}
