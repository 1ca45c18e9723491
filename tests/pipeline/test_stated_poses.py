import numpy as np
import pytest

from palpate.pipeline.metrics import pose_words, world_sigma


def test_sigma_is_along_the_axes_of_the_world():
    # The object looks along +y: 1 mm along its x are 1 mm along the world's y, 3 mm along its y along the world's x.
    quarter = [0.1, 0.2, np.pi / 2]
    assert world_sigma(quarter, np.diag([1e-6, 9e-6, 4e-4])) == pytest.approx([3e-3, 1e-3, 0.02])
    # Turned by 30 degrees: 1/4 of the one variance and 3/4 of the other.
    found = world_sigma([0.0, 0.0, np.pi / 6], np.diag([4e-6, 0.0, 0.0]))
    assert found == pytest.approx([np.sqrt(3e-6), 1e-3, 0.0])


def test_a_pose_in_words():
    said = pose_words([-0.0626, 0.10956, np.pi / 6], [0.0026, 0.00199, np.radians(0.96)])
    assert said == "x -62.6 ± 2.6 mm, y 109.6 ± 2.0 mm, yaw 30.0 ± 1.0°"
