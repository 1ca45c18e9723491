"""Models: lists of variables and factors, and the code that is generated from them."""
