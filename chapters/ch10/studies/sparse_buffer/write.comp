// Study sparse-buffer: writes all words of the pages that have memory; a work group for each place.

#define ACCESS writeonly
#include "words.glsl"

layout(local_size_x = 128) in;

void main() {
    uint place = gl_WorkGroupID.x, page = pages[place];
    if (page == NONE) {
        return;
    }
    for (uint index = gl_LocalInvocationIndex; index < WORDS; index += gl_WorkGroupSize.x) {
        words[place * WORDS + index] = word_of(page, index);
    }
}
