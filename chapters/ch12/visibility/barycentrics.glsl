// Where a pixel lies in a triangle, and how that changes from pixel to pixel, from the clip positions of three vertices.
//
// Let the rows of M be (x, y, w) of the vertices. Attributes divided by w are linear on the screen, so the weights of the
// vertices at (X, Y) are proportional to e = (X, Y, 1) M^-1, and the perspective-correct ones are e / sum(e). The inverse
// divides by det M, which cancels there: the adjugate is enough. Its columns are cross products of rows, finite even if
// a vertex is behind the eye.
//
// The origin is moved to the pixel first: (X, Y) becomes (0, 0), and x becomes x - X w. Without that, e of a triangle of
// one pixel would be the small difference of products of numbers near 1, and lose half of its digits in 32 bits.

struct Barycentrics {
    vec3 at;  // weights of the vertices, sum 1
    vec3 dx;  // their change from this pixel to the next one in a row
    vec3 dy;  // and to the next row
};

// `size` is that of a pixel in (X, Y), 2 divided by the number of pixels.
Barycentrics barycentrics_of(vec4 a, vec4 b, vec4 c, vec2 ndc, vec2 size) {
    precise vec3 w = vec3(a.w, b.w, c.w);
    precise vec3 x = vec3(a.x, b.x, c.x) - ndc.x * w;
    precise vec3 y = vec3(a.y, b.y, c.y) - ndc.y * w;
    // A common factor cancels. This one keeps products of three numbers within range.
    vec3 largest = max(max(abs(x), abs(y)), abs(w));
    float unit = 1.0 / max(max(largest.x, max(largest.y, largest.z)), 1e-30);
    x *= unit;
    y *= unit;
    w *= unit;
    precise vec3 e = x.yzx * y.zxy - x.zxy * y.yzx;
    precise vec3 along_x = w.zxy * y.yzx - w.yzx * y.zxy;
    precise vec3 along_y = w.yzx * x.zxy - w.zxy * x.yzx;
    float sum = e.x + e.y + e.z, sizes = abs(e.x) + abs(e.y) + abs(e.z);
    Barycentrics result = Barycentrics(vec3(1.0 / 3.0), vec3(0.0), vec3(0.0));
    if (abs(sum) <= 1e-6 * sizes) {
        // An edge-on triangle: its weights have no meaning at a pixel beside it.
        return result;
    }
    result.at = e / sum;
    vec3 least = min(result.at, 0.0);
    if (least.x + least.y + least.z < -1.0) {
        // A triangle thinner than the grid of the rasteriser covers pixels that lie beside it by many of its widths. Its
        // nearest point stands for them.
        result.at = max(result.at, 0.0);
        result.at /= result.at.x + result.at.y + result.at.z;
    }
    float scale = 1.0 / sum;
    result.dx = clamp((along_x - result.at * (along_x.x + along_x.y + along_x.z)) * scale * size.x, -1e4, 1e4);
    result.dy = clamp((along_y - result.at * (along_y.x + along_y.y + along_y.z)) * scale * size.y, -1e4, 1e4);
    return result;
}
