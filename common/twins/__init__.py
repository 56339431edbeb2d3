"""Functions of the shaders again in float64: the truth that tests hold the GPU to."""
