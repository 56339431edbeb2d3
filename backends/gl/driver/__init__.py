"""The OpenGL driver: its calls and numbers, its capabilities, and its messages."""
