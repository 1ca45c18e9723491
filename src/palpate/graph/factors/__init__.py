"""The terms of the graph, one file a factor: its settings, its residual with derivatives, its weight and its source."""
