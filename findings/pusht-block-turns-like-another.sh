#!/bin/sh
# gym-pusht 0.1.8 (pymunk 6.11.1): the T of PushT turns as a body with another centre and 1.55 times the inertia.
#
# PushT is LeRobot's task of planar pushing. Its T is of one material by all that its documentation says; `block_cog` is
# for a "center of gravity of the block if different from the center of mass". The centres of its two bars, of 3600 and
# 2700 square units, are averaged as if they weighed the same, and the moment is that of the bar twice, once for the
# stem, each of the whole mass (huggingface/gym-pusht#22, taken over from diffusion_policy). `moment_for_poly` of pymunk
# gives the moment about the body's origin, though its documentation speaks of the centroid: four times that of a plate
# whose corner is the origin. `density` of pymunk's shapes, as here, finds centre and moment rightly.
# A model of pushing that is fitted to such data does not fit a real T.
# Seen: the centre is 45 units from the top of the T instead of 40.7, the moment 3000 instead of 1932 per unit of mass;
# one push of the bar by 117 units turns it by 34.7 degrees, and by 40.0 with its own centre and moment.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "opencv-python-headless==5.0.0.93" \
    "numpy==2.4.6" "shapely==2.2.0" "pymunk==6.11.1" "pygame==2.6.1" "gymnasium==1.4.0"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check --no-deps "gym-pusht==0.1.8"
PYGAME_HIDE_SUPPORT_PROMPT=1 "$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import numpy as np
import pymunk
from gym_pusht.envs.pusht import PushTEnv


def by_density(shapes):
    """Return centre and moment per unit of mass of plates of one material, by pymunk itself."""
    space = pymunk.Space()
    body = pymunk.Body()
    plates = [pymunk.Poly(body, shape.get_vertices()) for shape in shapes]
    for plate in plates:
        plate.density = 1.0
    space.add(body, *plates)
    return body.center_of_gravity, body.moment / body.mass


def turned_by_push(centre, moment):
    """Push one end of the bar by 117 units and return how far the T has turned [degrees]."""
    environment = PushTEnv(obs_type="state")
    environment.reset(seed=0)
    environment.block.center_of_gravity = centre
    environment.block.moment = moment
    environment.block.angle = 0.0
    environment.block.position = (256.0, 200.0)
    environment.agent.position = (301.0, 275.0)
    environment.space.step(0.01)
    for step in range(40):
        environment.step(np.array([301.0, 275.0 - 3.0 * step]))
    return abs(np.degrees(environment.block.angle))


environment = PushTEnv(obs_type="state")
environment.reset(seed=0)
block = environment.block
centre, moment = by_density(block.shapes)
corner = pymunk.moment_for_poly(1.0, [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)])
as_is = turned_by_push(block.center_of_gravity, block.moment)
own = turned_by_push(centre, moment)
print("gym-pusht", importlib.metadata.version("gym-pusht"), "pymunk", pymunk.version)
print("centre %.1f below the top, of the T itself %.1f" % (block.center_of_gravity.y, centre.y))
print("moment %.0f per unit of mass, of the T itself %.0f" % (block.moment / block.mass, moment))
print("one push turns it by %.1f degrees, with its own centre and moment by %.1f" % (as_is, own))
print("plate of 4 by 2 from its corner: moment_for_poly %.2f, about its centroid %.2f" % (corner, 20.0 / 12.0))
assert abs(centre.y - 40.714) < 0.01 and abs(moment - 1931.6) < 1.0, "the reference has changed"
assert abs(block.center_of_gravity.y - 45.0) < 0.01, "behaviour has changed: centre of the T"
assert abs(block.moment / block.mass - 3000.0) < 1.0, "behaviour has changed: moment of the T"
assert own - as_is > 2.0, "behaviour has changed: turn of a push"
assert abs(corner - 4.0 * 20.0 / 12.0) < 1e-6, "behaviour has changed: moment_for_poly is about the centroid"
PYTHON
