"""The passes of a frame, one module each."""
