"""The factor graph of one contact: variables, factors and the sliding window that solves it."""
