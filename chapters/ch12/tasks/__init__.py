"""Tasks: work with a name, what it comes after, and the threads that run it."""
