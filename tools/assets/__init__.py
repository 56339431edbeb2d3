"""`strata assets` and `strata convert`: models fetched, examined, shrunk and converted."""
