"""The scene as shaders read it: geometry, records, materials, and the draws of a frame."""
