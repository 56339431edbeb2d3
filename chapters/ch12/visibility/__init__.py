"""The visibility buffer: which triangle is nearest at each pixel, and the surface rebuilt from that number alone."""
