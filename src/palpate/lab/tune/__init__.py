"""Settings learnt from recordings with ground truth."""
