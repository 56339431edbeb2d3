"""The window of `strata run`: its loop, its cameras, and what its user changes."""
