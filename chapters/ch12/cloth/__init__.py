"""Cloth: springs and particles that compute moves, and the scene that is drawn with them."""
