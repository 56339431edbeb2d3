"""Variable rate shading: one evaluation of light for a block of pixels, where the eye does not see the difference."""
