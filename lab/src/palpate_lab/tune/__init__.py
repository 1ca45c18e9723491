"""Tuning: noise settings learnt from recordings with ground truth."""
