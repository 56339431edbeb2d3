"""Queues and timelines: submissions to queues, and waits between them."""
