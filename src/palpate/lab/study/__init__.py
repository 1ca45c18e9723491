"""Studies: the recordings of a folder tracked in several ways, and with faults; tables, figures and a report page."""
