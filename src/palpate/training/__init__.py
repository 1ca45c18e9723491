"""Learning to feel: touch models from recordings with ground truth. Needs the extra `train`."""
