// Study cluster-list: what a task shader hands to the mesh shaders that it launches.

const uint IN_TASK = 32u;

struct Payload {
    uvec2 chosen[IN_TASK];  // instance, meshlet
};
