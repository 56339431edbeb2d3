"""`strata frame` and `strata graph`: one frame pass by pass, and the graph behind it."""
