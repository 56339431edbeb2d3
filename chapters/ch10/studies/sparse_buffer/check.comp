// Study sparse-buffer: reads all words that have memory, and counts those that are not of the page that is bound there.

#define ACCESS readonly
#include "words.glsl"

layout(local_size_x = 128) in;

layout(BIND(0, 2, 2), std430) writeonly buffer Counts_ { uvec2 counts[]; };

shared uvec2 parts[gl_WorkGroupSize.x];

void main() {
    uint place = gl_WorkGroupID.x, page = pages[place], part = gl_LocalInvocationIndex;
    uvec2 found = uvec2(0u);
    if (page != NONE) {
        for (uint index = part; index < WORDS; index += gl_WorkGroupSize.x) {
            found += uvec2(1u, words[place * WORDS + index] == word_of(page, index) ? 0u : 1u);
        }
    }
    parts[part] = found;
    barrier();
    if (part == 0u) {
        for (uint i = 1u; i < gl_WorkGroupSize.x; ++i) {
            found += parts[i];
        }
        counts[place] = found;
    }
}
