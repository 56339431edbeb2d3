"""`strata diff`: what one chapter adds to another, in the terminal and as a page."""
