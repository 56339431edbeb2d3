"""Transparency that does not depend on the order of draws: layers of each pixel in lists, or weighted blending."""
