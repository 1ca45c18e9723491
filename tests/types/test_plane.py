"""Poses in space as poses in a plane."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate import FileError
from palpate.geometry import se2
from palpate.types.plane import into_plane, out_of_plane, plane_across, plane_through


def test_a_level_plane_keeps_x_and_y():
    rng = np.random.default_rng(1)
    poses = rng.normal(size=(20, 3))
    position = np.column_stack([poses[:, :2], np.full(20, 0.3)])
    plane = plane_across("world", np.array([0.0, 0.0, 2.0]), position)
    assert plane.tilt == 0.0
    found, height, angle = into_plane(plane, position, Rotation.from_euler("z", poses[:, 2:]).as_quat())
    assert found[:, :2] == pytest.approx(poses[:, :2], abs=1e-12)
    assert se2.wrap(found[:, 2] - poses[:, 2]) == pytest.approx(0.0, abs=1e-12)
    assert (height, angle) == (pytest.approx(0.3), pytest.approx(0.0, abs=1e-12))


def test_a_tilted_plane_is_fitted_and_yaw_is_about_its_normal():
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(-0.2, 0.2, (50, 2)), rng.uniform(-3, 3, 50)])
    tilt = Rotation.from_euler("y", 0.2)
    plane = plane_across("world", tilt.apply([0.0, 0.0, 1.0]), np.zeros((1, 3)))
    # The plane's x axis is the frame's, laid down into it.
    assert plane.axes == pytest.approx(tilt.as_matrix(), abs=1e-12)
    position, rotation = out_of_plane(plane, poses)
    assert position == pytest.approx(tilt.apply(np.column_stack([poses[:, :2], np.zeros(50)])), abs=1e-12)
    fitted = plane_through("world", position + tilt.apply([0.0, 0.0, 0.05]))
    assert fitted.axes == pytest.approx(plane.axes, abs=1e-9)
    assert (fitted.height, fitted.tilt) == (pytest.approx(0.05), pytest.approx(0.2))
    found, height, angle = into_plane(fitted, position, rotation)
    assert found[:, :2] == pytest.approx(poses[:, :2], abs=1e-9)
    assert se2.wrap(found[:, 2] - poses[:, 2]) == pytest.approx(0.0, abs=1e-9)
    assert (height, angle) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-9))


def test_a_line_and_a_normal_of_zero_tell_no_plane():
    line = np.linspace(0, 1, 20)[:, None] * np.array([1.0, 2.0, 0.5])
    with pytest.raises(FileError, match=r"moves along a line, 0\.0 mm across, .*--plane X Y Z"):
        plane_through("world", line)
    with pytest.raises(FileError, match="not all 0"):
        plane_across("world", np.zeros(3), line)
