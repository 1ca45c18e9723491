"""Making recordings: pushes of known objects by known sensors."""
