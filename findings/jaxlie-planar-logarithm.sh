#!/bin/sh
# jaxlie 1.5.0 (jax 0.10.2): the logarithm of a planar pose turned by a third of a degree is off by a millimetre.
#
# jax computes in 32 bits unless told otherwise, where a pose of half a metre is right to some 1e-8 m. `SE2.log` divides
# by cos(a) - 1, which at small angles has hardly a digit left, and takes its series only where that is below 1e-5, at
# less than 0.26 degrees. `SE3.log` of the same pose is right. (`SE3.exp` has a like gap below 0.2 degrees, of 0.6 mm.)
# The README lists "Taylor approximations near singularities". A residual of two poses of a pushed object is such a
# logarithm, and the steps of a push are such angles.
# Seen: of poses at (0.3, 0.4) m that are turned by 0.2 to 1 degree, `SE2.log` is up to 1.1 mm off, `SE3.log` less than
# 1e-4 mm.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check "jaxlie==1.5.0" "jax==0.10.2" "jaxlib==0.10.2" \
    "numpy==2.4.6"
JAX_PLATFORMS=cpu "$folder/venv/bin/python" - <<'PYTHON'
import importlib.metadata

import jax
import jax.numpy as jnp
import numpy as np
from jaxlie import SE2, SE3, SO3

X = 0.3  # m
Y = 0.4
angles = np.radians(np.linspace(0.2, 1.0, 200)).astype(np.float32)


def planar(angle):
    return SE2.from_xy_theta(X, Y, angle).log()[:2]


def spatial(angle):
    pose = SE3.from_rotation_and_translation(SO3.from_z_radians(angle), jnp.array([X, Y, 0.0]))
    return pose.log()[:2]


half = angles.astype(float) / 2.0
share = half / np.tan(half)
exact = np.stack((share * X + half * Y, share * Y - half * X), axis=-1)
off = {}
for name, logarithm in (("SE2.log", planar), ("SE3.log", spatial)):
    found = np.asarray(jax.vmap(logarithm)(jnp.array(angles)), float)
    off[name] = 1e3 * np.abs(found - exact).max()
print("jaxlie", importlib.metadata.version("jaxlie"), "jax", jax.__version__, "in", angles.dtype)
for name, value in off.items():
    print(f"{name}: up to {value:.1e} mm off")
assert off["SE3.log"] < 1e-3, "the reference has changed"
assert off["SE2.log"] > 0.3, "behaviour has changed: SE2.log is right at small angles"
PYTHON
