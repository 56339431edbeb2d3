"""The images and buffers of a graph, and their places in memory."""
