"""Culling: what a frame leaves out because it is outside of the view, faces away, or is hidden behind something."""
