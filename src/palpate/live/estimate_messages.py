"""An estimate of a live session as ROS messages, alike in what is recorded and what is published."""

from collections.abc import Mapping

import numpy as np

from palpate.io.bags.estimates_mcap import NOTHING, add_estimates
from palpate.io.bags.message_sink import MessageSink
from palpate.live.poses import SensorPlace
from palpate.types.estimate import Estimate
from palpate.types.plane import Plane
from palpate.types.trajectory import Trajectory


def add_estimate(
    sink: MessageSink,
    plane: Plane,
    stamp: int,
    estimate: Estimate,
    place: SensorPlace,
    latency: float,
    more: Mapping[str, str] = NOTHING,
) -> None:
    """Add the messages of an estimate in a plane with its stamp [ns].

    All its answers are among them. Its diagnosis tells how the sensor's pose was known, how long the estimate took [s],
    and `more`.
    """
    one = Trajectory(
        np.array([estimate.time]),
        estimate.pose[None],
        estimate.covariance[None],
        np.array([estimate.contact]),
        (estimate.status,),
    )
    said = {
        "reason": estimate.reason,
        "sensor pose": place.how,
        "sensor pose age [ms]": f"{1e3 * place.age:.1f}",
        "latency [ms]": f"{1e3 * latency:.1f}",
    }
    several = estimate.answers if len(estimate.answers) > 1 else ()
    add_estimates(sink, one, [stamp], plane, (several,), {**said, **more})
