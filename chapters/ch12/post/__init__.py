"""What follows shading: resolve, lens and tone mapping."""
