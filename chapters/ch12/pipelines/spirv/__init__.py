"""The declarations of compiled shaders: a parser of SPIR-V."""
