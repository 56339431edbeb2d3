"""`strata doctor`: what this machine can do, and a trial frame of each chapter."""
