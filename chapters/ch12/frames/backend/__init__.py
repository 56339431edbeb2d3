"""The backends of the renderer: one interface, with an implementation for each API."""
