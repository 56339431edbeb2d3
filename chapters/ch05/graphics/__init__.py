"""The graphics layer of this chapter: what stands between the passes and the Vulkan foundation."""
