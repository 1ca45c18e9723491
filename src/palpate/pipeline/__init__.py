"""A recording tracked from its first frame to its last: the run, its folder, its scores and figures."""
