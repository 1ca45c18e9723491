"""Live tracking: sources of images and sensor poses, the loop that tracks them, and its recorder."""
