"""Recording of draws: in parts, on several threads, and for repeated submission."""
