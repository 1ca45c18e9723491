"""The numbers that the paper prints: those of Table II. Its figures' values are not printed anywhere in its text."""

TABLE2 = {
    "const": {"disc": 5.5e-3, "rect": 15e-3, "ellip": 6.7e-3, "combined": 9.6e-3},
    "linear eng-feat": {"disc": 5.1e-3, "rect": 6.7e-3, "ellip": 4.2e-3, "combined": 5.9e-3},
    "linear learnt-feat": {"disc": 1.0e-3, "rect": 1.1e-3, "ellip": 1.7e-3, "combined": 1.5e-3},
    "nonlinear eng-feat": {"disc": 3.0e-3, "rect": 5.2e-3, "ellip": 3.3e-3, "combined": 4.2e-3},
    "nonlinear learnt-feat": {"disc": 1.0e-3, "rect": 1.7e-3, "ellip": 3.0e-3, "combined": 2.4e-3},
}
"""Validation losses by model and data set: half of the mean square error of the sine of the yaw."""
