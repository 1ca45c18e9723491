"""`python -m palpate.ros2 --ros-args -p shape:=NAME -p first_pose:='[x, y, theta]' -r image:=/digit/image_raw ...`."""

import sys
from collections.abc import Sequence

from palpate.cli.console import complain
from palpate.errors import PalpateError
from palpate.live.ros2_topics import Ros2Node
from palpate.live.session import stop_on_signals
from palpate.ros2.node import run


def main(arguments: Sequence[str]) -> int:
    """Run the node until Ctrl-C and return its exit code."""
    try:
        ros = Ros2Node("palpate", arguments)
    except PalpateError as error:
        complain(error)
        return 2
    logger = ros.node.get_logger()
    try:
        with stop_on_signals() as stop:
            state = run(ros, stop, logger.info)
    except PalpateError as error:
        logger.error(str(error))
        return 2
    else:
        one = state.counts
        counts = f"{one['images']} images, {one['tracked']} tracked, {one['dropped']} dropped"
        logger.info(f"{counts}, {one['without_pose']} without a sensor pose, {ros.lost} lost by ROS")
        return 0
    finally:
        ros.close()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
