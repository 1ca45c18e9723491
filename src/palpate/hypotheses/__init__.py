"""Several hypotheses of where the object is: proposed, solved in one window, weighed, merged and dropped."""
