"""Volumetric fog: a grid of froxels holds the light that air scatters to the eye, and surfaces are seen through it."""
