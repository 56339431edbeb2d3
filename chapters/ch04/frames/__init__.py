"""Frames in flight: slots, commands, resources, timings, and the images that are read."""
