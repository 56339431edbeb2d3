// The place of a dispatch in the picture, which is traced in tiles.

struct Tile { uvec4 first; };  // x, y: the pixel of invocation 0
PUSH(Tile, tile)
