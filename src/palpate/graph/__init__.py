"""What everything says together: factors, their noise and the smoothers. Knows nothing of images."""
