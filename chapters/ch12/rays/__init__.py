"""Rays against the scene: by ray-tracing pipelines, by ray queries, and by a hierarchy of the project's own."""
