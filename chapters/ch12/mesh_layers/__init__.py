"""Shadow maps of all layers of a target at once: task and mesh shaders that draw the meshlets of casters."""
