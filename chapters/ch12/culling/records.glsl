// The records and the pushed constants of culling; the layouts are those of culling/lists.py and meshlets/model.py.

struct Draw {
    uint instance;
    uint first_meshlet;
    uint units;
    uint batch;
    uint first_index;
    uint index_count;
    uint first_bit;
    uint flags;
};
const uint WHOLE = 1u, ALWAYS = 2u, TWO_SIDED = 4u;
uint coarser_levels(Draw draw) { return draw.flags >> 4u & 15u; }
uint first_level(Draw draw) { return draw.flags >> 8u; }

struct Meshlet {
    vec4 sphere;  // middle of the box, radius
    vec3 extent;  // half the edges of the box
    uint cone;
    uint first_index;
    uint counts;  // vertices | triangles << 8
    uint data;
    uint mesh;
};

struct Sizes {
    uvec4 counts;  // draws, batches, whether it counts, first word of the counts of commands
    uvec4 firsts;  // first word of the arguments of mesh draws, of the sums of draws, of the sums of units; blocks of draws
    uvec4 more;    // phase; commands of a phase; instances; places of units. Of task shaders: y, w the first draw of the
                   // batch and of the next one
};

// What views know of a unit, in 7 bits: 0 for a whole mesh, and 1 to 63 for a meshlet, by its number; 64 more in the
// late phase. A draw command has them as bits 24 to 30 of its vertex offset, above the number of a vertex: a page of
// 128 MiB has at most 11.2 million positions of 12 bytes, less than 2^24. Bit 31 stays 0, since OpenGL leaves open what
// a number of a vertex below 0 is.
uint unit_code(uint phase, uint meshlet) { return phase * 64u + 1u + meshlet % 63u; }

const uint PHASES = 2u, COUNTER_WORDS = 16u, ARGUMENT_WORDS = 16u, DRAWN = 0x80000000u;
const uint DRAWS_TESTED = 0u, DRAWS_OUTSIDE = 1u, DRAWS_HIDDEN = 2u, UNITS_TESTED = 3u, UNITS_OUTSIDE = 4u,
           UNITS_AWAY = 5u, UNITS_HIDDEN = 6u, UNITS_DRAWN = 7u, TRIANGLES_DRAWN = 8u, UNITS_DROPPED = 9u,
           MESHLETS_DRAWN = 10u, DRAWS_COARSER = 11u, COUNTERS = 12u;
