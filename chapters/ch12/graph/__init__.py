"""The frame graph: declared passes, compiled into a frame."""
