// The memory of the layers: how many each pixel has, and where they are. KEYS: with the layers themselves.
// POOL_SET is the descriptor set, POOL_BINDING the first binding in it.

layout(BIND(POOL_SET, 0, 9), std430) buffer Pool_ {
    uint layers;    // of the frame
    uint capacity;  // layers that there is room for
    uint width;     // pixels in a row
    uint overflow;  // 1: there are more layers than room
    uint words[];   // of each pixel, row by row: see model.py
} pool;

#ifdef KEYS
// Depth as bits, instance, triangle, place of the colour. As depth is never negative, its bits have its order.
layout(BIND(POOL_SET, 1, 10), std430) buffer Layer_keys_ { uvec4 keys[]; };
layout(BIND(POOL_SET, 2, 11), std430) buffer Layer_colors_ { vec4 colors[]; };
#endif

uint pixel_number(uvec2 pixel) { return pixel.y * pool.width + pixel.x; }
