// Study dispatch-size, fragments: how often each place was reached, and invocations without a place.

#define ACCESS readonly
#include "numbers.glsl"
#include "palette.glsl"

layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;

void main() {
    vec2 size = vec2(push.counted.xy), local = vec2(push.counted.zw), picture = vec2(push.launched.zw);
    vec2 region = ceil(size / local) * local;  // whole groups, as large as fits
    float scale = min(picture.x / region.x, picture.y / region.y);
    vec2 p = (in_uv * picture - 0.5 * (picture - scale * region)) / scale;
    vec3 color = vec3(0.05, 0.05, 0.06);
    if (all(greaterThanEqual(p, vec2(0.0))) && all(lessThan(p, region))) {
        uvec2 place = uvec2(p), group = place / push.counted.zw;
        if (all(lessThan(place, push.counted.xy))) {
            uint count = counters[place.y * push.counted.x + place.x] / REPEAT;
            color = vec3(float(count > 1u));
            if (count == 1u) {
                // The one invocation may belong to another place: shifted rows look the same.
                color = 0.85 * id_color(group.y * 4096u + group.x) * (0.9 + 0.1 * float((place.x ^ place.y) & 1u));
            }
        } else if (all(lessThan(place, push.launched.xy))) {
            color = vec3(0.35);
        }
    }
    out_color = vec4(color, 1.0);
}
