"""Features, the tests that hold them, and their results: `strata list`, `explain` and `test`."""
