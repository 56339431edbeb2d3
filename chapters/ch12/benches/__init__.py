"""The benches of this lesson, for `strata bench`."""
