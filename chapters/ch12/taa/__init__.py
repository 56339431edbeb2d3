"""Temporal anti-aliasing: a jittered projection, and a history of colour that averages what it draws."""
