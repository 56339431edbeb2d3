// The order of a pixel's layers: depth, then instance, then triangle, so that it depends neither on the order of draws nor
// on that of atomics. Reversed depth is smallest at the farthest layer, which is composited first.

bool is_before(uvec4 a, uvec4 b) {
    if (a.x != b.x) {
        return a.x < b.x;
    }
    if (a.y != b.y) {
        return a.y < b.y;
    }
    return a.z != b.z ? a.z < b.z : a.w < b.w;
}

vec3 over(uint place, vec3 under) {
    vec4 layer = colors[place];
    return layer.rgb * layer.a + under * (1.0 - layer.a);
}

// Puts `key` into a heap of `count` keys from `begin` on whose place `hole` is free and has both branches in order.
void sift(uint begin, uint count, uint hole, uvec4 key) {
    for (uint child = 2u * hole + 1u; child < count; child = 2u * hole + 1u) {
        uvec4 first = keys[begin + child];
        if (child + 1u < count) {
            uvec4 second = keys[begin + child + 1u];
            if (is_before(second, first)) {
                first = second;
                ++child;
            }
        }
        if (!is_before(first, key)) {
            break;
        }
        keys[begin + hole] = first;
        hole = child;
    }
    keys[begin + hole] = key;
}

// Composites the layers [begin, end) over `under`, farthest first. No list is too long: a heap needs no other memory.
vec3 composited(uint begin, uint end, vec3 under) {
    uint count = end - begin;
    if (count <= SHORT) {
        uvec4 last = uvec4(0u);
        for (uint done = 0u; done < count; ++done) {
            uvec4 next = uvec4(0xFFFFFFFFu);
            for (uint place = begin; place < end; ++place) {
                uvec4 key = keys[place];
                if (is_before(key, next) && (done == 0u || is_before(last, key))) {
                    next = key;
                }
            }
            under = over(next.w, under);
            last = next;
        }
        return under;
    }
    for (uint parent = count / 2u; parent-- > 0u;) {
        sift(begin, count, parent, keys[begin + parent]);
    }
    while (count > 0u) {
        under = over(keys[begin].w, under);
        --count;
        sift(begin, count, 0u, keys[begin + count]);
    }
    return under;
}
