"""One small workload per use of a feature, each in a file of its own: `run(bench)` returns what was wrong, or ""."""
