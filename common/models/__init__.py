"""Models by name: the manifest of well-known ones, and where fetched and own ones are kept."""
