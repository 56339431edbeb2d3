"""The frame graph: passes that declare what they read and write, compiled into a frame."""
