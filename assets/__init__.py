"""The scenes that the project makes itself, with their generators."""
