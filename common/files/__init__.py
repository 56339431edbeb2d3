"""Files that are read and written with care: blobs, caches, repairs, shader sources."""
