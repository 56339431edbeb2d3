"""Loading of textures and geometry from files to the GPU while frames are drawn."""
