"""The study: many recordings tracked in several ways, its results, its figures and its report."""
