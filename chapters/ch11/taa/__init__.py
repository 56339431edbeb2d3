"""Temporal anti-aliasing: each frame is drawn with its own sub-pixel shift, and a history holds the mean of many."""
