"""`strata compare`: two pictures of the same moment, and how far they are apart."""
