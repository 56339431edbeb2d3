"""What `strata bench` measures of this lesson: frame graphs and the G-buffer."""
