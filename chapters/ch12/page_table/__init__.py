"""Memory by need: the resolution that a picture asks of each light, and a pool of pages behind a table."""
