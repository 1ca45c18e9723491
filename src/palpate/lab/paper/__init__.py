"""The paper's own system, to compare with."""
