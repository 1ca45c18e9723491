"""Live tracking: sources of images and sensor poses, the loop between them, its recording and its table."""
