"""Textures of materials: which images are read how, in arrays or in slots."""
