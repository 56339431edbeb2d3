"""Motion vectors: how far each pixel's surface has moved in the picture since the frame before."""
