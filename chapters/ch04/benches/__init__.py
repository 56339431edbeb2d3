"""The benches of this lesson, for `strata bench`: frame graphs and the G-buffer."""
