"""Materials as records, and their textures as small files."""
