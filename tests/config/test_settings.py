"""Settings: allowed values, and one sentence on others."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate import NoiseSettings, SettingError, TrackerSettings

ABOVE, AT_LEAST, THREE = "a finite number above 0", "a finite number at least 0", "3 finite numbers above 0"
NORMAL = "a finite mean and a finite standard deviation above 0"


def changed(group: str, **values: Any) -> NoiseSettings:
    noise = NoiseSettings()
    return replace(noise, **{group: replace(getattr(noise, group), **values)})


@pytest.mark.parametrize(
    ("setting", "value", "allowed"),
    [
        ("contact.deviation", 0.0, ABOVE),
        ("contact.deviation", "1e-3", ABOVE),
        ("contact.deviation", True, ABOVE),
        pytest.param("contact.deviation", 10**400, ABOVE, id="huge"),
        ("contact.kernel", 0.0, f"{ABOVE}, or None"),
        ("sticking.sliding_share", None, AT_LEAST),
        ("friction_cone.share", -0.1, f"{AT_LEAST}, or None"),
        ("sensor_pose.deviation", (1e-4, -1e-4, 1e-3), THREE),
        ("sensor_pose.calibration", (0.0, -1e-3, 0.0), "3 finite numbers at least 0"),
        ("priors.friction_center", (0.0, 0.0), NORMAL),
        ("priors.grip", 0.4, NORMAL),
    ],
)
def test_a_bad_setting_is_named_with_what_is_allowed(setting, value, allowed):
    with pytest.raises(SettingError) as caught:
        changed(*setting.split(".")[:1], **{setting.split(".")[1]: value})
    assert str(caught.value) == f"{setting} is {value!r}; it must be {allowed}"


def test_numbers_become_floats():
    sticking = changed("sticking", still=1, share=np.float32(0.5), kernel=2).sticking
    assert [type(value) for value in (sticking.still, sticking.share, sticking.kernel)] == [float] * 3
    assert changed("sensor_pose", deviation=[1, 2, 3]).sensor_pose.deviation == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"tactile": "magic"}, "tactile is 'magic'; allowed are auto, none, "),
        ({"smoother": "magic"}, "smoother is 'magic'; allowed are fixed-lag, "),
        ({"noise": "published"}, "noise is 'published'; it must be palpate.NoiseSettings"),
        ({"hypotheses": 2.5}, "hypotheses is 2.5; allowed is a whole number from 1 on"),
        ({"hypotheses": True}, "hypotheses is True; allowed is a whole number from 1 on"),
        *[({"disturbance_rate": one}, f"disturbance_rate is {one!r}; ") for one in (0.0, -1, np.nan, 1e9, True)],
        *[({"tolerance": one}, f"tolerance is {one!r}; ") for one in ((10, 6), (10, 0.1), (0.01, 6), (0, 0.1), 0.01)],
    ],
)
def test_a_bad_tracker_setting_is_named_with_what_is_allowed(settings, message):
    with pytest.raises(SettingError) as caught:
        TrackerSettings(**settings)
    assert message in str(caught.value)
