"""Light from an environment: cube maps and a table that are computed before the first frame."""
