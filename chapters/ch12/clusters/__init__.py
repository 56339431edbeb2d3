"""Clustered lights: each pixel loops over the few lights that may reach it, out of thousands."""
