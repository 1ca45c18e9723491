"""The laboratory: it simulates, trains and studies; nothing in the product imports from it."""
