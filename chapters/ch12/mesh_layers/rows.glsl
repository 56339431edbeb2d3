// The rows of a round, which layers.comp writes: for each batch of draws the arguments of its task shaders, then an element
// for each list. ROWS is the buffer.

// The element of a batch's arguments: task groups along x and y, 1, and their number.
uint row_of(uint batch, uint layers) { return batch * (1u + layers); }

// The element of a list: x the task groups of the lists before it, yz the layers of its faces, a byte for each face, w the
// faces that are drawn in this round, as bits.
uint list_row(uint batch, uint layers, uint list) { return row_of(batch, layers) + 1u + list; }

uint layer_of(uvec4 row, uint face) { return row[1u + face / 4u] >> (8u * (face & 3u)) & 255u; }

const uint BY_MESH_SHADERS = 8u;  // flag of a draw beside those of culling/records.glsl; of a whole mesh it says that `first_bit`
                                 // is the number of its vertices (shadows/lists.py)

const uint TASK_ENTRIES = 32u;  // entries of a list for each task group
