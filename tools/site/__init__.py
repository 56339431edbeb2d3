"""`strata docs`: the site, built from texts, pictures and records of the project."""
