"""Touch: contact and measurements from images."""
