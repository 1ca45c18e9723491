"""What images say: from frames to measurements. Knows nothing of the graph."""
