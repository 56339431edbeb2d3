"""Scenes that open faster the second time: arrays in one mapped file."""
