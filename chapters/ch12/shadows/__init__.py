"""Shadow maps of all kinds of lights: faces of lights, cut into pages, read through a table."""
