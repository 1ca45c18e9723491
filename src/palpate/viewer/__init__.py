"""Views of runs and recordings: files for Rerun, and one HTML page."""
