"""Planar geometry: poses, outlines of objects and the distance to them. Knows nothing of sensors or files."""
