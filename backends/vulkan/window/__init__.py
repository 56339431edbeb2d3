"""The window on Vulkan: swapchain, and the user interface over the picture."""
