"""Studies: the recordings of a folder tracked in several ways; tables and figures."""
