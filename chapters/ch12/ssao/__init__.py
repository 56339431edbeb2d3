"""Ambient occlusion in screen space: how much of the light from everywhere the surroundings of a pixel hide."""
