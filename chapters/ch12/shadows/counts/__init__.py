"""How much was drawn for shadows, where kernels decide it: added up on the GPU, and told when a frame is over."""
