"""`strata bench`: time, error and work of chapters, their records, and how two records differ."""
