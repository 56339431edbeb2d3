"""High dynamic range: the exposure that the GPU finds, and bloom."""
