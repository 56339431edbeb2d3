"""Execution of a compiled graph on each backend."""
