"""Learning what images say: touch models from recordings with ground truth. Needs the extra `train`."""
