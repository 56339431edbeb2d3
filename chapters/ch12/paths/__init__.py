"""A path tracer: the same scene with all of its light, by random paths whose mean is the picture."""
