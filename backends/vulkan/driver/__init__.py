"""The Vulkan driver: features and extensions, and its messages."""
