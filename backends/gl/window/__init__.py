"""The window on OpenGL: the picture in it, and the user interface over the picture."""
