"""Synchronization of a compiled graph: barriers and queues, and their form on each backend."""
