"""Ground truth from an overhead camera: printed tags on table, object and sensor give their poses in a video."""
