"""Meshlets: meshes cut into small groups of triangles, each with bounds of its own."""
