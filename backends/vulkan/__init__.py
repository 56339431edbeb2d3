"""The Vulkan foundation: binding, device, memory, resources, shaders, window, readback."""
