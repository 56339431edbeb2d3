"""Linear algebra, sampling, statistics, and the allocators that hand out ranges and handles."""
