"""GLSL to SPIR-V: compiler, cache, and the interface that a program expects of its host."""
