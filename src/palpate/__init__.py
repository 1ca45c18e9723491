"""Finds the pose of an object by touch."""

__version__ = "0.1.0"
