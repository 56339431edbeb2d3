"""Textures and geometry on their way from files to the GPU, beside the frames."""
