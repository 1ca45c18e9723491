"""Planar rigid motions and the functions of residuals, for numbers, for symbols and for compiled code."""
