#!/bin/sh
# stonesoup 1.9.1: the cubature filter hardly uses a bearing near half a turn, and its `alpha` scales its gain.
#
# Angles are of a type of their own (`Bearing`), and the extended and the unscented updater wrap them. The cubature
# transform multiplies them as numbers: where the points of the prediction lie on both sides of half a turn, the
# variance of the predicted bearing is nearly that of +-pi. So an object straight behind the sensor, at -x, is not moved
# by its bearing, and the variance across it, at the prediction's own, is not reduced.
# `alpha`, "Scaling parameter. Default is 1.0. Lower values select points closer to the mean and vice versa", is not
# passed on to the points, only to the covariance of state and measurement: that, and so the gain, is divided by it.
# Of a linear measurement each spread of points has to give the Kalman filter (Arasaratnam and Haykin 2009).
# Seen: of a bearing 0.05 rad off that moves an object at 0 or 90 degrees by 46 mm, the one at 180 degrees is moved by
# 1 mm; with alpha 0.5 a gain of 0.5 is 1.0.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "stonesoup==1.9.1" "numpy==2.4.6" "scipy==1.17.1"
"$folder/venv/bin/python" - <<'PYTHON'
import datetime
import importlib.metadata
import math

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
from stonesoup.types.angle import Bearing
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.updater.kalman import CubatureKalmanUpdater, KalmanUpdater, UnscentedKalmanUpdater

NOW = datetime.datetime(2026, 1, 1)
SIGHT = CartesianToBearingRange(2, [0, 1], CovarianceMatrix(np.diag([1e-3, 1e-2])))


def updated(updater, mean, covariance, measured, model):
    """Return the mean after an update, and the covariance."""
    prediction = GaussianStatePrediction(StateVector(mean), CovarianceMatrix(covariance), timestamp=NOW)
    detection = Detection(StateVector(measured), timestamp=NOW, measurement_model=model)
    posterior = updater.update(SingleHypothesis(prediction, detection))
    return np.asarray(posterior.mean, float).ravel(), np.asarray(posterior.covar, float)


def across(kind, degrees):
    """Return how far [m] an object 1 m away is moved across the line of sight, and the variance there [m^2]."""
    angle = math.radians(degrees)
    place = [math.cos(angle), math.sin(angle)]
    mean, covariance = updated(kind(SIGHT), place, 0.01 * np.eye(2), [Bearing(angle + 0.05), 1.0], SIGHT)
    side = np.array([-math.sin(angle), math.cos(angle)])
    return float(side @ mean), float(side @ covariance @ side)


print("stonesoup", importlib.metadata.version("stonesoup"))
moved = {}
for degrees in (0.0, 90.0, 180.0):
    moved[degrees], variance = across(CubatureKalmanUpdater, degrees)
    peer, _ = across(UnscentedKalmanUpdater, degrees)
    way = 1e3 * moved[degrees]
    left = f"of 0.01 m^2 are left {variance:.4f}"
    print(f"{degrees:.0f} degrees: moved by {way:.0f} mm, unscented {1e3 * peer:.0f}; {left}")
    assert abs(peer - 0.0455) < 1e-3, "the reference has changed"
assert abs(moved[0.0] - 0.0455) < 1e-3 and abs(moved[90.0] - 0.0455) < 1e-3, "the reference has changed"
assert abs(moved[180.0]) < 0.01, "behaviour has changed: bearings near half a turn are used"

line = LinearGaussian(1, [0], CovarianceMatrix([[1.0]]))
gains = {}
for name, updater in (
    ("Kalman", KalmanUpdater(line)),
    ("cubature", CubatureKalmanUpdater(line)),
    ("cubature, alpha 0.5", CubatureKalmanUpdater(line, alpha=0.5)),
):
    gains[name] = float(updated(updater, [0.0], np.eye(1), [1.0], line)[0][0])
    print(f"{name}: gain {gains[name]:.2f}")
assert abs(gains["Kalman"] - 0.5) < 1e-9 and abs(gains["cubature"] - 0.5) < 1e-9, "the reference has changed"
assert gains["cubature, alpha 0.5"] > 0.9, "behaviour has changed: alpha does not scale the gain"
PYTHON
