"""Passes and functions that light the scene: passes for surfaces, light and sky, and the views of single quantities."""
