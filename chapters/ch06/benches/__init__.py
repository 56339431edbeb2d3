"""The benches of this lesson, for `strata bench`: stages of culling, the visible set, and the size of meshlets."""
