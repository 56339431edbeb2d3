// The pixels of a picture in blocks, one for each work group: RUN pixels for each of 256 invocations.

layout(local_size_x = 256) in;

struct Picture {
    uvec4 picture;  // pixels, width, capacity in layers, blocks
};
PUSH(Picture, of)

const uint BLOCK = 256u * RUN;

// The dispatch has a second axis where the first is too short.
uint block() { return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x; }
