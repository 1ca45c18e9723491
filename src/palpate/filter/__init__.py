"""Several hypotheses of where the object is, what measurements say for each, and whether they are consistent."""
