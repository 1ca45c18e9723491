"""Studies: the recordings of a folder tracked in several ways; tables, figures and a report page."""
