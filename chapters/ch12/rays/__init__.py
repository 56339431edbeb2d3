"""Rays: structures that find the nearest surface along a ray, and a picture that is traced with them."""
