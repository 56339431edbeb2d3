"""What compiled shaders declare: a parser of SPIR-V."""
