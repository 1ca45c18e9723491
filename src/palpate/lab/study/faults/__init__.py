"""Faults of sensors and of what a tracker is told, one at a time, and what becomes of the estimate."""
