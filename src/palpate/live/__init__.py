"""Tracking as it happens: sources of images and sensor poses, the loop between them, what it records and shows."""
