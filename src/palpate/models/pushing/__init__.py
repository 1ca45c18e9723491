"""Quasi-static planar pushing of an object with a known outline by a touching sensor."""
