"""Casters that move: which ones, and the faces that they touch."""
