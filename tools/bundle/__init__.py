"""`strata bundle`: the clone with its packages and models in one file."""
