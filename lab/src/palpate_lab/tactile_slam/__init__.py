"""A baseline for outlines that are not known: Gaussian process and factor graph in turn (Suresh et al., ICRA 2021)."""
