"""Self-tests of OpenGL drivers: each module tries one use, `run(bench)` returns what was wrong, or ""."""
