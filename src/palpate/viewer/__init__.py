"""View of a run: one HTML page."""
