"""Queues and timelines: what is submitted where, and what waits for what."""
