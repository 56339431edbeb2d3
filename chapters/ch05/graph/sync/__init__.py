"""What a compiled graph synchronizes: barriers, queues, and their words on each backend."""
