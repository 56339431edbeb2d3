"""Self-tests of drivers: what each use computes, and the verdicts that are kept."""
