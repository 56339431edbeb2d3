"""What no lesson teaches about a graphics API: bindings, devices, memory, shaders, windows, readback."""
