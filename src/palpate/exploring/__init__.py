"""Tracking of an object whose outline is unknown, or known as a sketch: pose and outline together."""
