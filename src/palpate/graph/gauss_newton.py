"""One Gauss-Newton step of all rows of a window, in compiled code: linearise, eliminate step by step, substitute back.

All rows share the terms, which are sorted by step, in each step those of pushing first.
"""

import math

import numpy as np
from numpy.typing import NDArray

from palpate.graph import factors, measured, pushing
from palpate.graph.block_tridiagonal import eliminate, inflate, last_covariance, step_into_past, substitute_back
from palpate.graph.compiled import Array, Records, compiled
from palpate.graph.contact_geometry import CONTACT_GEOMETRY, Surface, put_touch
from palpate.graph.factors import FIRST_POSE, FRICTION_CONE, LINEAR, OWN, STICKING
from palpate.graph.se2_kernels import adjoint, between, copy, exp_onto, log, position, rotation, wrap
from palpate.graph.variables import CONTACT_SIZE, LAST_SIZE, OBJECT_SIZE, SHARED_SIZE, STEP_SIZE, WIDTH

_FULL_WEIGHT = 1.0 - 1e-9  # share of the weight left by a kernel that counts as all


@compiled
def linearise(before: Records, now: Records, row: Records, term: Records, settings: Records, out: Records) -> int:
    """Write the linearised rows of a term and return their number."""
    kind = term.kind
    if kind == factors.STICKING:
        return pushing.sticking(before, now, row, term, settings, out)
    if kind == factors.BALANCE:
        return pushing.balance(before, now, row, term, settings, out)
    if kind == factors.FRICTION_CONE:
        return pushing.friction_cone(before, now, row, term, settings, out)
    if kind == factors.FIRST_POSE:
        return measured.first_pose(now, row, term, out)
    if kind == factors.SENSOR_POSE:
        return measured.sensor_pose(now, row, term, settings, out)
    if kind == factors.CONTACT:
        return measured.contact(now, row, term, settings, out)
    if kind == factors.DIRECTION:
        return measured.direction(now, row, term, settings, out)
    if kind == factors.PLACE:
        return measured.place(now, row, term, settings, out)
    if kind == factors.TURN:
        return measured.turn(now, row, term, settings, out)
    return measured.object_pose(now, row, term, out)


@compiled
def improve(
    steps: Records,
    rows: Records,
    changing: NDArray[np.bool_],
    terms: Records,
    settings: Records,
    drift: Array,
    surface: Surface,
    own: Array,
) -> None:
    """Take a Gauss-Newton step of the rows that are `changing` (B,); the others keep their solution.

    steps (B, N) are STEP, rows (B,) ROW, terms (T,) TERM. `drift` (LAST_SIZE,) are variances by which numbers of the
    last step and shared variables change from step to step, `own` (B, ...) is `own_measurements.evaluated`.
    """
    # A record does not keep its array alive: callees take arrays of what is made here.
    parts, room = np.empty(len(surface.parts), CONTACT_GEOMETRY), np.zeros(1, LINEAR)
    root, y = np.empty((steps.shape[1], STEP_SIZE, WIDTH)), np.empty((steps.shape[1], STEP_SIZE))
    last_root, last_y = np.empty((LAST_SIZE, WIDTH)), np.empty(LAST_SIZE)
    for b in range(len(changing)):
        if not changing[b]:
            continue
        row = rows[b]
        copy(row.shared, row.at_shared)
        for k in range(steps.shape[1]):
            now = steps[b, k]
            copy(now.g, now.at_g)
            copy(now.e, now.at_e)
            _put_touch(now, surface, parts)
        is_found = _eliminate_steps(steps[b], row, terms, settings, drift, own[b], room, root, y, last_root, last_y)
        if is_found and _move(steps[b], row, root, y, last_root, last_y):
            _put_touch(steps[b, -1], surface, parts)
            _conclude(steps[b], row, terms, settings, last_root, room)
        else:
            row.is_lost, row.change = True, 0.0


@compiled
def _put_touch(now: Records, surface: Surface, parts: Records) -> None:
    """Write rotations and contact geometry, which several kernels use."""
    now.turn_g, now.turn_e = rotation(now.g[2]), rotation(now.e[2])
    put_touch(position(now.g), now.turn_g, surface, parts, now.touch)


@compiled
def _eliminate_steps(
    steps: Records,
    row: Records,
    terms: Records,
    settings: Records,
    drift: Array,
    own: Array,
    room: Records,
    root: Array,
    y: Array,
    last_root: Array,
    last_y: Array,
) -> bool:
    """Linearise all terms and eliminate all numbers, oldest step first; False if they are indeterminate."""
    system, gradient, out, t = np.zeros((WIDTH, WIDTH)), np.zeros(WIDTH), room[0], 0
    _begin_with_past(steps[0], row, system, gradient)
    for k in range(len(steps)):
        now, before = steps[k], steps[max(k - 1, 0)]
        now.cost[0] = now.cost[1] = 0.0
        for kind in range(len(now.squares)):
            now.squares[kind] = 0.0
        now.force_angle = pushing.force_angle(steps, k, row, settings)
        if k > 0:
            step_into_past(system, gradient)
        is_past_written = k != 1
        while t < len(terms) and terms[t].step == k:
            term = terms[t]
            if not is_past_written and term.kind > FRICTION_CONE:
                is_past_written = True
                _write_next_past(row, drift, system, gradient)
            count = (
                _copy(own[term.index], out) if term.kind == OWN else linearise(before, now, row, term, settings, out)
            )
            _add_costs(term.kind, count, out, now)
            _add(count, out, system, gradient)
            t += 1
        if k > 0 and not eliminate(0, STEP_SIZE, system, gradient, root[k - 1], y[k - 1]):
            return False
    return eliminate(STEP_SIZE, WIDTH, system, gradient, last_root, last_y)


@compiled
def _copy(own: Array, out: Records) -> int:
    """Write the rows (R, 1 + LAST_SIZE) of a measurement with its own residual, and return their number."""
    for r in range(len(own)):
        out.residual[r], out.information[r], out.weight[r] = own[r, 0], 1.0, 1.0
        for c in range(LAST_SIZE):
            out.jacobian[r, STEP_SIZE + c] = own[r, 1 + c]
    return len(own)


@compiled
def _begin_with_past(oldest: Records, row: Records, system: Array, gradient: Array) -> None:
    """Write what older steps say about the oldest one in the window and the shared variables."""
    change = np.empty(LAST_SIZE)
    between(row.past_g, oldest.g, change[:3])
    between(row.past_e, oldest.e, change[3:6])
    log(change[:3], change[:3])
    log(change[3:6], change[3:6])
    for i in range(SHARED_SIZE):
        change[STEP_SIZE + i] = row.shared[i] - row.past_shared[i]
    for i in range(LAST_SIZE):
        gradient[STEP_SIZE + i] = row.past_gradient[i]
        for j in range(LAST_SIZE):
            gradient[STEP_SIZE + i] -= row.past_information[i, j] * change[j]
            system[STEP_SIZE + i, STEP_SIZE + j] = row.past_information[i, j]


@compiled
def _write_next_past(row: Records, drift: Array, system: Array, gradient: Array) -> None:
    """Write what the oldest step will say about the next one once it has left; all its terms are in the system."""
    system, gradient = np.copy(system), np.copy(gradient)
    is_found = eliminate(0, STEP_SIZE, system, gradient, np.empty((STEP_SIZE, WIDTH)), np.empty(STEP_SIZE))
    for i in range(LAST_SIZE):
        row.next_gradient[i] = gradient[STEP_SIZE + i] if is_found else math.nan
        for j in range(i, LAST_SIZE):
            value = system[STEP_SIZE + i, STEP_SIZE + j] if is_found else math.nan
            row.next_information[i, j] = row.next_information[j, i] = value
    inflate(drift, row.next_information, row.next_gradient)


@compiled
def _add(count: int, out: Records, system: Array, gradient: Array) -> None:
    """Add the rows of a term to the system, and clear them."""
    for r in range(count):
        row = out.jacobian[r]
        for i in range(WIDTH):
            if row[i] != 0.0:
                pull = out.weight[r] * row[i]
                gradient[i] -= pull * out.residual[r]
                for j in range(i, WIDTH):
                    system[i, j] += pull * row[j]
        for i in range(WIDTH):
            row[i] = 0.0


@compiled
def _add_costs(kind: int, count: int, out: Records, now: Records) -> None:
    """Add half the square of each row, reduced by its kernel, to the cost of its step.

    A Cauchy kernel of scale k gives a square s the weight w = 1 / (1 + s / k^2) and the cost k^2 log(1 + s / k^2) / 2,
    which is -s w / (1 - w) log(w) / 2. The costs of several rows under one kernel add up to this.
    """
    for r in range(count):
        square = out.information[r] * out.residual[r] ** 2
        now.squares[kind] += square
        if kind == FIRST_POSE or not out.information[r] > 0.0:  # a belief from before is no evidence
            continue
        left = out.weight[r] / out.information[r]
        if left < _FULL_WEIGHT:
            square *= -left / (1.0 - left) * math.log(left)
        now.cost[1 if kind <= FRICTION_CONE else 0] += 0.5 * square


@compiled
def _move(steps: Records, row: Records, root: Array, y: Array, last_root: Array, last_y: Array) -> bool:
    """Move all values, newest step first; False if a change is not finite."""
    change, largest = np.empty(WIDTH), 0.0
    if not substitute_back(STEP_SIZE, last_root, last_y, change):
        return False
    for i in range(SHARED_SIZE):
        row.shared[i] += change[2 * STEP_SIZE + i]
    for k in range(len(steps) - 1, -1, -1):
        now = steps[k]
        exp_onto(now.at_g, change[STEP_SIZE : STEP_SIZE + 3], now.g)
        exp_onto(now.at_e, change[STEP_SIZE + 3 : 2 * STEP_SIZE], now.e)
        turn = rotation(now.e[2] - now.g[2])
        place = position(now.e) - turn * position(now.g)
        now.object[0], now.object[1], now.object[2] = place.real, place.imag, wrap(now.e[2] - now.g[2])
        for i in range(STEP_SIZE, 2 * STEP_SIZE):
            largest = max(largest, abs(change[i]))
        if k > 0:
            if not substitute_back(0, root[k - 1], y[k - 1], change):
                return False
            copy(change[:STEP_SIZE], change[STEP_SIZE : 2 * STEP_SIZE])
    row.change = largest
    return True


@compiled
def _conclude(steps: Records, row: Records, terms: Records, settings: Records, last_root: Array, room: Records) -> None:
    """Write what the moved values say at the last step: angle of the force, errors of pushing, and the object."""
    last, out = len(steps) - 1, room[0]
    now, before, t = steps[last], steps[max(last - 1, 0)], len(terms) - 1
    for k in range(max(last - pushing.REACH, 0), last):
        steps[k].turn_g, steps[k].turn_e = rotation(steps[k].g[2]), rotation(steps[k].e[2])
    now.force_angle = pushing.force_angle(steps, last, row, settings)
    while last > 0 and t >= 0 and terms[t].step == last:
        if terms[t].kind < FRICTION_CONE:  # sticking has two rows, balance one
            count = linearise(before, now, row, terms[t], settings, out)
            for r in range(count):
                place = r if terms[t].kind == STICKING else 2
                row.errors[place] = abs(out.residual[r]) * math.sqrt(out.information[r])
                for c in range(WIDTH):
                    out.jacobian[r, c] = 0.0
        t -= 1
    _put_object_covariance(now.g, row, last_root)


@compiled
def _put_object_covariance(g: Array, row: Records, last_root: Array) -> None:
    """Write the covariance of the object: o = e g^-1 moves by Ad_g (d_e - d_g)."""
    covariance, turned = np.empty((LAST_SIZE, LAST_SIZE)), np.empty((3, 3))
    last_covariance(last_root, covariance)
    adjoint(g, turned)
    by_last = np.zeros((3 + OBJECT_SIZE, LAST_SIZE))
    for r in range(3):
        for c in range(3):
            by_last[r, c], by_last[r, 3 + c] = -turned[r, c], turned[r, c]
    for i in range(OBJECT_SIZE):
        by_last[3 + i, STEP_SIZE + CONTACT_SIZE + i] = 1.0
    for i in range(3 + OBJECT_SIZE):
        pulled = np.zeros(LAST_SIZE)
        for k in range(LAST_SIZE):
            for j in range(LAST_SIZE):
                pulled[j] += by_last[i, k] * covariance[k, j]
        for j in range(i, 3 + OBJECT_SIZE):
            total = 0.0
            for k in range(LAST_SIZE):
                total += pulled[k] * by_last[j, k]
            row.covariance[i, j] = row.covariance[j, i] = total


@compiled
def extrapolate(steps: Records) -> None:
    """Set the last sensor pose in the object, in steps (B, N), by constant motion from the two before it."""
    last, turned = steps.shape[1] - 1, np.empty(3)
    for b in range(len(steps)):
        before, now = steps[b, last - 1].g, steps[b, last].g
        between(steps[b, max(last - 2, 0)].g, before, turned)
        ahead = position(before) + rotation(before[2]) * position(turned)
        now[0], now[1], now[2] = ahead.real, ahead.imag, wrap(before[2] + turned[2])
