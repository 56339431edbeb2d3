"""`strata run`: a chapter opened and drawn, and what a run leaves behind."""
