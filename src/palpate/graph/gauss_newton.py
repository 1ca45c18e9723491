"""Gauss-Newton steps of all rows of a window, in compiled code: linearise, eliminate step by step, substitute back.

All rows share the terms of measurements, which are sorted by step. The normal equations are block-tridiagonal in the
steps, with a border for the variables that all steps share, and are eliminated oldest step first. The numbers of two
steps and of the shared variables form one small system (WIDTH,): once the older step is eliminated, the rest is a
Gaussian on the newer step and the shared variables, which is all that the past says about what follows. The cost is
proportional to the number of steps. Only the upper triangles of matrices count.
"""

import math

from palpate.arrays import Array, Flags, Integers, Records
from palpate.compiled import compiled, kernel
from palpate.config import CONVERGED, PREDICTED, REACH, SHORT
from palpate.graph import factors, measured, pushing
from palpate.graph.contact_geometry import Surface, put_touch
from palpate.graph.factors import BALANCE, CONTACT, FIRST_POSE, FRICTION_CONE, OWN, SENSOR_POSE, STICKING
from palpate.graph.se2_kernels import adjoint, between, exp_onto, log, position, rotation, wrap
from palpate.graph.variables import LAST_SIZE, SHARED_SIZE, STEP_SIZE, WIDTH

assert STEP_SIZE == 6, "eliminate_step writes out six rows"
_FULL_WEIGHT = 1.0 - 1e-9  # share of the weight left by a kernel that counts as all

Own = tuple[Integers, Array]
"""Steps (M,) of own measurements, and their rows; see `own_measurements.evaluated`."""
Given = tuple[Records, Array, Surface, Records]
"""Settings from `make_factors`, variances (LAST_SIZE,) by which numbers of the last step and shared variables change
from step to step, the surfaces in contact, and room for computing (1,), `factors.WORK`."""


@kernel
def of_step(kind: int, before: Records, now: Records, row: Records, settings: Records, out: Records) -> int:
    """Write the linearised rows of a factor that needs no measurement of touch, and return their number."""
    if kind == factors.STICKING:
        return pushing.sticking(before, now, row, settings, out)
    if kind == factors.BALANCE:
        return pushing.balance(before, now, row, settings, out)
    if kind == factors.FRICTION_CONE:
        return pushing.friction_cone(before, now, row, settings, out)
    if kind == factors.FIRST_POSE:
        return measured.first_pose(now, row, out)
    if kind == factors.SENSOR_POSE:
        return measured.sensor_pose(now, settings, out)
    return measured.contact(now, row, settings, out)


@kernel
def of_term(now: Records, row: Records, term: Records, settings: Records, corners: Array, out: Records) -> int:
    """Write the linearised rows of the term of a measurement and return their number."""
    sign = row.sign if term.from_touch == 1.0 else 1.0
    value = sign * term.value
    if term.kind == factors.DIRECTION:
        return measured.direction(now, row, term, value, settings, out)
    if term.kind == factors.PLACE:
        return measured.place(now, row, term, value, settings, out)
    if term.kind == factors.TURN:
        return measured.turn(now, row, term, value, settings, out)
    if term.kind == factors.CORNER:
        return measured.corner(now, row, term, sign, settings, corners, out)
    return measured.object_pose(now, term, out)


@compiled
def improve(
    steps: Records,
    left: int,
    rows: Records,
    terms: Records,
    own: Own,
    given: Given,
    changing: Flags,
    iterations: int,
) -> None:
    """Take Gauss-Newton steps of the rows that are `changing` (B,) until each has converged, which clears its flag.

    Steps (B, N) are STEP, after `left` that have left the window, rows (B,) ROW, and terms (T,) TERM. A row takes
    so many iterations at most.
    """
    settings, _drift, surface, work = given
    for b in range(len(rows)):
        if not changing[b]:
            continue
        row, its, of_row = rows[b], steps[b], (own[0], own[1][b])
        for _ in range(iterations):
            for k in range(len(its)):
                _put_touch(its[k], surface)
            is_found = _eliminate_steps(its, left, row, terms, of_row, given)
            row.is_lost = not (is_found and _move(its, row, work[0].change))
            changing[b] = not row.is_lost and row.change >= CONVERGED
            if not changing[b]:
                break
        if not row.is_lost:
            _put_touch(its[len(its) - 1], surface)
            _conclude(its, row, settings[0], work[0])
            _put_innovations(its, left, row, terms, of_row, given)
            _put_surprise(its, left, row)


@kernel
def _put_touch(now: Records, surface: Surface) -> None:
    """Write rotations and contact geometry, which several kernels use."""
    now.turn_g, now.turn_e = rotation(now.g[2]), rotation(now.e[2])
    put_touch(position(now.g), now.turn_g, surface, now.touch)


@kernel
def _eliminate_steps(steps: Records, left: int, row: Records, terms: Records, own: Own, given: Given) -> bool:
    """Linearise all factors and eliminate all numbers, oldest step first; False if they are indeterminate."""
    settings, drift, corners, work = given[0][0], given[1], given[2].corners, given[3][0]
    system, gradient, out, t = work.system, work.gradient, work.linear, 0
    system[:], gradient[:] = 0.0, 0.0
    _begin_with_past(steps[0], row, work)
    for k in range(len(steps)):
        now, before = steps[k], steps[max(k - 1, 0)]
        now.cost[:2], now.cost_of_belief = 0.0, 0.0
        now.force_angle = pushing.force_angle(steps, k, row, settings)
        if k > 0:
            step_into_past(system, gradient)
        for kind in range(CONTACT + 1):
            if kind == FIRST_POSE:
                if k == 1:
                    _write_next_past(now, row, drift, work)
                if left + k > 0:
                    continue
            if k > 0 or kind > FRICTION_CONE:
                count = of_step(kind, before, now, row, settings, out)
                _add(kind, count, out, now, system, gradient)
        while t < len(terms) and terms[t].step == left + k:
            _add(int(terms[t].kind), of_term(now, row, terms[t], settings, corners, out), out, now, system, gradient)
            t += 1
        for m in range(len(own[0])):
            if own[0][m] == left + k:
                _add(int(OWN), _copy(own[1][m], out), out, now, system, gradient)
        if k > 0 and not eliminate_step(system, gradient, before.root, before.y):
            return False
    return eliminate(STEP_SIZE, system, gradient, row.last_root, row.last_y)


@kernel
def _copy(own: Array, out: Records) -> int:
    """Write the rows (R, 1 + LAST_SIZE) of a measurement with its own residual, and return their number."""
    for r in range(len(own)):
        out.residual[r], out.information[r], out.weight[r] = own[r, 0], 1.0, 1.0
        for c in range(LAST_SIZE):
            out.jacobian[r, STEP_SIZE + c] = own[r, 1 + c]
    return len(own)


@kernel
def _begin_with_past(oldest: Records, row: Records, work: Records) -> None:
    """Write what older steps say about the oldest one in the window and the shared variables."""
    past, system, gradient, change, moved = row.past, work.system, work.gradient, work.change, work.linear.error
    between(past.g, oldest.g, moved)
    log(moved, change[:3])
    between(past.e, oldest.e, moved)
    log(moved, change[3:6])
    for i in range(SHARED_SIZE):
        change[STEP_SIZE + i] = row.shared[i] - past.shared[i]
    for i in range(LAST_SIZE):
        gradient[STEP_SIZE + i] = past.gradient[i]
        for j in range(LAST_SIZE):
            gradient[STEP_SIZE + i] -= past.information[i, j] * change[j]
            system[STEP_SIZE + i, STEP_SIZE + j] = past.information[i, j]


@kernel
def _write_next_past(second: Records, row: Records, drift: Array, work: Records) -> None:
    """Write what the oldest step will say about the second once it has left; all its factors are in the system."""
    work.next_system, work.next_gradient = work.system, work.gradient
    system, gradient, past = work.next_system, work.next_gradient, row.next_past
    is_found = eliminate_step(system, gradient, work.next_root, work.next_y)
    past.g, past.e, past.shared = second.g, second.e, row.shared
    for i in range(LAST_SIZE):
        past.gradient[i] = gradient[STEP_SIZE + i] if is_found else math.nan
        for j in range(i, LAST_SIZE):
            value = system[STEP_SIZE + i, STEP_SIZE + j] if is_found else math.nan
            past.information[i, j] = past.information[j, i] = value
    inflate(drift, past.information, past.gradient, work.change)


@kernel
def _add(kind: int, count: int, out: Records, now: Records, system: Array, gradient: Array) -> None:
    """Add the rows of a factor to the system and their costs to those of the step, and clear them.

    The cost is half the square of each row, reduced by its kernel. A Cauchy kernel of scale k gives a square s the
    weight w = 1 / (1 + s / k^2) and the cost k^2 log(1 + s / k^2) / 2, which is -s w / (1 - w) log(w) / 2. The costs of
    several rows under one kernel add up to this.
    """
    for r in range(count):
        row, weight, residual = out.jacobian[r], out.weight[r], out.residual[r]
        for i in range(WIDTH):
            if row[i] != 0.0:
                pull = weight * row[i]
                gradient[i] -= pull * residual
                for j in range(i, WIDTH):
                    system[i, j] += pull * row[j]
        row[:] = 0.0
        square = out.information[r] * residual**2
        if kind == FIRST_POSE:
            now.cost_of_belief += 0.5 * square
        if kind == FIRST_POSE or not out.information[r] > 0.0:
            continue
        left = weight / out.information[r]
        if left < _FULL_WEIGHT:
            square *= -left / (1.0 - left) * math.log(left)
        now.cost[1 if kind <= FRICTION_CONE else 0] += 0.5 * square


@kernel
def _move(steps: Records, row: Records, change: Array) -> bool:
    """Move all values, newest step first; False if a change is not finite. `change` (WIDTH,) is room."""
    largest = total = 0.0
    substitute_back(STEP_SIZE, row.last_root, row.last_y, change)
    for i in range(SHARED_SIZE):
        row.shared[i] += change[2 * STEP_SIZE + i]
    for i in range(LAST_SIZE):
        row.moved[i] = change[STEP_SIZE + i]
    for k in range(len(steps) - 1, -1, -1):
        now = steps[k]
        exp_onto(now.g, change[STEP_SIZE:])
        exp_onto(now.e, change[STEP_SIZE + 3 :])
        turn = rotation(now.e[2] - now.g[2])
        place = position(now.e) - turn * position(now.g)
        now.object[0], now.object[1], now.object[2] = place.real, place.imag, wrap(now.e[2] - now.g[2])
        for i in range(STEP_SIZE, 2 * STEP_SIZE):
            largest = max(largest, abs(change[i]))
            total += change[i]  # which is not finite if one of them is not
        if k > 0:
            substitute_back(0, steps[k - 1].root, steps[k - 1].y, change)
            for i in range(STEP_SIZE):
                change[STEP_SIZE + i] = change[i]
    row.change = largest
    return math.isfinite(total)


@kernel
def _conclude(steps: Records, row: Records, settings: Records, work: Records) -> None:
    """Write what the moved values say at the last step: angle of the force, innovations of pushing, and the object."""
    last, out = len(steps) - 1, work.linear
    now, before = steps[last], steps[max(last - 1, 0)]
    for k in range(max(last - REACH, 0), last):
        steps[k].turn_g, steps[k].turn_e = rotation(steps[k].g[2]), rotation(steps[k].e[2])
    now.force_angle = pushing.force_angle(steps, last, row, settings)
    row.innovations[:SENSOR_POSE], now.surprise[:] = 0.0, 0.0
    if last > 0 and now.spread == 0.0:
        for kind in (STICKING, BALANCE):
            for r in range(of_step(kind, before, now, row, settings, out)):
                row.innovations[kind, r, 0], row.innovations[kind, r, 2] = out.residual[r], 1.0 / out.information[r]
                now.surprise[kind] += out.information[r] * out.residual[r] ** 2
                out.jacobian[r] = 0.0
    _put_object_covariance(now.g, row, work)


@kernel
def _put_innovations(its: Records, left: int, row: Records, terms: Records, own: Own, given: Given) -> None:
    """Write the innovations of the last step's sensor pose, contact and own measurements, and of terms that arrived."""
    last, settings, corners, out = len(its) - 1, given[0][0], given[2].corners, given[3][0].linear
    row.innovations[SENSOR_POSE:] = 0.0
    for kind in (SENSOR_POSE, CONTACT):
        _put_innovation(kind, last, of_step(kind, its[last], its[last], row, settings, out), 0.0, its, row, out)
    for t in range(len(terms)):
        if terms[t].arrived == left + last:
            k = int(terms[t].step) - left
            count = of_term(its[k], row, terms[t], settings, corners, out)
            _put_innovation(int(terms[t].kind), k, count, terms[t].variance, its, row, out)
    for m in range(len(own[0])):
        if own[0][m] == left + last:
            count = _copy(own[1][m], out)
            for r in range(count):  # its residual is from before the last Gauss-Newton step
                for i in range(LAST_SIZE):
                    out.residual[r] += out.jacobian[r, STEP_SIZE + i] * row.moved[i]
            _put_innovation(int(OWN), last, count, 0.0, its, row, out)


@kernel
def _put_innovation(kind: int, k: int, count: int, stated: float, steps: Records, row: Records, out: Records) -> None:
    """Write the innovations of the linearised rows of a factor of step k, and clear these.

    The residual r once all is fused, and the variance a = H P H' that is left of it, give the innovation r R / (R - a)
    before the row was fused with variance R, and the variance a R / (R - a) of what was predicted. There is none where
    nothing else predicts the row. A `stated` variance of 0 is that of the settings.
    """
    surprise = steps[len(steps) - 1].surprise
    for r in range(count):
        jacobian, variance = out.jacobian[r], 0.0
        for j in range(k, len(steps) - 1):
            for i in range(STEP_SIZE):
                jacobian[i], jacobian[STEP_SIZE + i] = jacobian[STEP_SIZE + i], 0.0
            variance += substitute_forward(0, steps[j].root, jacobian)
        variance += substitute_forward(STEP_SIZE, row.last_root, jacobian)
        jacobian[:] = 0.0
        share, innovation = 1.0 - variance * out.weight[r], row.innovations[kind, r]
        if share > PREDICTED:
            innovation[0], innovation[1] = out.residual[r] / share, variance / share
            innovation[2] = stated if stated > 0.0 else 1.0 / out.information[r]
            surprise[kind] += innovation[0] ** 2 / (innovation[1] + 1.0 / out.information[r])


@kernel
def _put_surprise(steps: Records, left: int, row: Records) -> None:
    """Write the mean squared innovations of the last steps; see `factors.ROW`."""
    first = len(steps) - SHORT
    for kind in range(OWN + 1):
        row.surprise[kind] = 0.0
        if left + first >= 0:
            for k in range(max(first, 0), len(steps)):
                row.surprise[kind] += steps[k].surprise[kind] / SHORT


@kernel
def _put_object_covariance(g: Array, row: Records, work: Records) -> None:
    """Write the covariance of the object: o = e g^-1 moves by Ad_g (d_e - d_g)."""
    out, size = work.linear, len(row.covariance)
    adjoint(g, out.adjoint)
    for i in range(size):
        by = out.jacobian[i]
        if i < 3:
            for j in range(3):
                by[STEP_SIZE + j], by[STEP_SIZE + 3 + j] = -out.adjoint[i, j], out.adjoint[i, j]
        else:
            by[WIDTH - size + i] = 1.0
        substitute_forward(STEP_SIZE, row.last_root, by)
        for j in range(i + 1):
            product = 0.0
            for k in range(STEP_SIZE, WIDTH):
                product += by[k] * out.jacobian[j, k]
            row.covariance[i, j] = row.covariance[j, i] = product
    out.jacobian[:] = 0.0


@compiled
def begin_step(steps: Records) -> None:
    """Begin the last of the steps (B, N), in which the measured sensor pose and `STEP.spread` are set.

    The sensor pose in the object is that of constant motion from the two steps before.
    """
    last = steps.shape[1] - 1
    for b in range(len(steps)):
        now, before = steps[b, last], steps[b, last - 1]
        now.moved = abs(position(now.measured) - position(before.measured))
        now.cost[2] = 1.0 if now.spread > 0.0 else 0.0
        between(steps[b, max(last - 2, 0)].g, before.g, now.g)
        ahead = position(before.g) + rotation(before.g[2]) * position(now.g)
        now.g[0], now.g[1], now.g[2] = ahead.real, ahead.imag, wrap(before.g[2] + now.g[2])


@kernel
def eliminate(first: int, system: Array, gradient: Array, root: Array, y: Array) -> bool:
    """Eliminate as many numbers as `y` has, from `first` on; False if they are indeterminate.

    Their rows of the upper Cholesky root, and of root^-T gradient, are written to root (len(y), WIDTH) and y. Rows are
    computed in full, in loops of constant length, which is quicker than their upper triangle.
    """
    for p in range(len(y)):
        pivot, row = first + p, root[p]
        if not system[pivot, pivot] > 0.0:  # not for NaN either
            return False
        share = 1.0 / math.sqrt(system[pivot, pivot])
        y[p] = share * gradient[pivot]
        for j in range(first, WIDTH):
            row[j] = share * system[pivot, j]
        for i in range(pivot + 1, first + len(y)):
            gradient[i] -= row[i] * y[p]
            for j in range(first, WIDTH):
                system[i, j] -= row[i] * row[j]
    return True


@kernel
def eliminate_step(system: Array, gradient: Array, root: Array, y: Array) -> bool:
    """Eliminate the older step, and subtract root^T root from the rest of the system, root^T y from its gradient.

    The six rows are written out, so that an element of the system is read and written once.
    """
    if not eliminate(0, system, gradient, root, y):
        return False
    for i in range(STEP_SIZE, WIDTH):
        a, b, c, d, e, f = root[0, i], root[1, i], root[2, i], root[3, i], root[4, i], root[5, i]
        gradient[i] = gradient[i] - a * y[0] - b * y[1] - c * y[2] - d * y[3] - e * y[4] - f * y[5]
        for j in range(STEP_SIZE, WIDTH):
            left = system[i, j] - a * root[0, j] - b * root[1, j] - c * root[2, j]
            system[i, j] = left - d * root[3, j] - e * root[4, j] - f * root[5, j]
    return True


@kernel
def substitute_back(first: int, root: Array, y: Array, change: Array) -> None:
    """Write the change (WIDTH,) of the numbers from `first` on that were eliminated; those after them have theirs."""
    for c in range(len(y) - 1, -1, -1):
        total = y[c]
        for j in range(first + c + 1, WIDTH):
            total -= root[c, j] * change[j]
        change[first + c] = total / root[c, first + c]


@kernel
def substitute_forward(first: int, root: Array, row: Array) -> float:
    """Multiply a row (WIDTH,) by the inverse of a root of numbers from `first` on; return the variance they give it."""
    variance = 0.0
    for p in range(len(root)):
        share = row[first + p] / root[p, first + p]
        variance += share**2
        row[first + p] = share
        for j in range(first + p + 1, WIDTH):
            row[j] -= share * root[p, j]
    return variance


@kernel
def step_into_past(system: Array, gradient: Array) -> None:
    """Make the newer step of a system the older one of the next, whose newer step has no terms yet."""
    for i in range(STEP_SIZE):
        gradient[i], gradient[STEP_SIZE + i] = gradient[STEP_SIZE + i], 0.0
        for j in range(STEP_SIZE):
            system[i, j], system[STEP_SIZE + i, STEP_SIZE + j] = system[STEP_SIZE + i, STEP_SIZE + j], 0.0
            system[i, STEP_SIZE + j] = 0.0
        for j in range(2 * STEP_SIZE, WIDTH):
            system[i, j], system[STEP_SIZE + i, j] = system[STEP_SIZE + i, j], 0.0


@kernel
def inflate(variance: Array, information: Array, gradient: Array, pulled: Array) -> None:
    """Let numbers of a Gaussian (N,) change at random, with these variances (N,); `pulled` (N,) is room."""
    for p in range(len(variance)):
        if variance[p] > 0.0:
            left, change = 1.0 / (information[p, p] + 1.0 / variance[p]), gradient[p]
            for i in range(len(variance)):
                pulled[i] = information[p, i]
            for i in range(len(variance)):
                gradient[i] -= change * left * pulled[i]
                for j in range(len(variance)):
                    information[i, j] -= left * pulled[i] * pulled[j]
