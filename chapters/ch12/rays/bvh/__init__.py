"""The bounding volume hierarchy that compute shaders traverse where a device has no ray tracing of its own."""
