"""Where the images and buffers of a graph lie, and which share memory."""
