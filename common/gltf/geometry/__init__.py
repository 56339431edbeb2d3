"""Geometry of a glTF file: primitives as triangles, completed, deformed and packed."""
