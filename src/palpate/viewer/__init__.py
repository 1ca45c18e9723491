"""Views of runs and recordings: in Rerun, live or afterwards, and as one HTML page."""
