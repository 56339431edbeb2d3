"""What `strata bench` measures of this lesson: queues and cloth."""
