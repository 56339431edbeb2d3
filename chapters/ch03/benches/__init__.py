"""What `strata bench` measures of this lesson: loading."""
