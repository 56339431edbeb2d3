"""Meshes: files, order, levels of detail, merging, and how far two surfaces are apart."""
