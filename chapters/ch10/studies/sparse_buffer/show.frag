// Study sparse-buffer: a cell for each place, in the colour of the page that its words name; a grey grid without memory.

#define ACCESS readonly
#include "words.glsl"
#include "palette.glsl"

struct Push {
    vec4 size;  // of the picture, in pixels
};
PUSH(Push, push)

layout(location = 0) out vec4 out_color;

const int ROWS = 8;   // along each edge of the picture
const int BLOCKS = 16;  // of a cell, each shows one word

void main() {
    ivec2 block = ivec2(gl_FragCoord.xy) * ROWS * BLOCKS / ivec2(push.size.xy);
    ivec2 cell = block / BLOCKS, within = block % BLOCKS;
    uint place = uint(cell.y * ROWS + cell.x);
    bool edge = within.x == 0 || within.y == 0;
    vec3 color = vec3((edge ? 64.0 : 46.0) / 255.0);
    if (pages[place] != NONE) {
        uint word = words[place * WORDS + uint(within.y * BLOCKS + within.x) * (WORDS / uint(BLOCKS * BLOCKS))];
        color = id_color(word >> 24) * (edge ? 0.3 : 0.7 + 0.3 * float(word & 0xffffffu) / 16777215.0);
    }
    out_color = vec4(color, 1.0);
}
