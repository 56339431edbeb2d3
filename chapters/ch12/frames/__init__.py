"""Frames in flight: slots, commands, resources, timings, and readback of images."""
