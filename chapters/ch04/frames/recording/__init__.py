"""How draws become commands: parts, threads, and recordings that are submitted again."""
