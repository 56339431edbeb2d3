"""What `./strata` does before Strata can run: look at the machine, decide, make `.venv`. Standard library alone."""
