"""How a compiled graph is carried out on each backend."""
