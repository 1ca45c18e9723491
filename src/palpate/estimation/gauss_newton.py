"""Gauss-Newton steps of all rows of a window, in compiled code: linearise, eliminate step by step, substitute back.

All rows share the terms of measurements, which are sorted by step. What the numbers mean is known to the model alone:
its `Functions` linearise factors and move variables; see `estimation.eliminate` for the matrix.
"""

import math
from functools import cache, partial
from typing import Any

import numpy as np

from palpate.arrays import Array, Integers, Records
from palpate.compiled import Compiled, compiled, kernel
from palpate.estimation.compiled_model import BELIEF, MEASUREMENT, PROCESS, Functions, Given, Own, copy_own
from palpate.estimation.eliminate import inflate
from palpate.estimation.innovations import make_put_innovations, make_put_process_innovations, make_put_surprise
from palpate.estimation.records import RecordTypes

CONVERGED = 5e-5
"""[m], [rad] Largest change of a variable of a step that ends the iterations. With a limit six times as large, real
pushes are tracked worse."""
RECENT = 10
"""Last steps of a window, which every iteration of a frame linearises. Earlier ones are linearised in the first one and
then follow these, which saves a quarter of the solver's time."""
FAR = 10.0 * CONVERGED
"""[m], [rad] Change of an earlier step from which all are linearised again."""
_FULL_WEIGHT = 1.0 - 1e-9  # share of the weight left by a robust kernel that counts as all


def make_improve(model: Functions, records: RecordTypes, given: Given, name: str) -> Compiled:
    """Return the compiled function that improves rows of a window of a model; `name` tells models apart on disk.

    `given` is an example of what the model is given.
    """
    improve_row = make_improve_row(model)

    def improve(
        steps: Records,
        left: int,
        rows: Records,
        terms: Records,
        own: Own,
        given: Given,
        recent: Integers,
        iterations: int,
    ) -> int:
        """Take Gauss-Newton steps of rows, in each of which so many `recent` steps (B,) are linearised every time.

        A row with 0 of them keeps its solution; one that has converged or is lost gets 0. Returns the number of lost
        rows. Steps are (N, B), after `left` that have left the window, rows (B,) and terms (T,); see
        `estimation.records`. A row takes so many iterations at most.
        """
        lost = 0
        for b in range(len(rows)):
            if recent[b] > 0:
                own_of_row = (own[0], own[1][b])
                if not improve_row(steps[:, b], left, rows[b], terms, own_of_row, given, recent[b], iterations):
                    recent[b] = 0
            lost += rows[b].is_lost
        return lost

    return compiled(
        np.zeros((1, 1), records.step),
        0,
        np.zeros(1, records.row),
        np.zeros(1, records.term),
        (np.zeros(1, np.int64), np.zeros((1, 1, 1, 1))),
        given,
        np.zeros(1, np.int64),
        0,
        name=f"improve_{name}",
    )(improve)


def make_improve_row(model: Functions) -> Any:
    """Return the compiled function of a model that takes Gauss-Newton steps of one row."""
    eliminate_steps = make_eliminate_steps(model)
    move = make_move(model)
    put_object = make_put_object(model)
    put_process_innovations = make_put_process_innovations(model)
    put_innovations = make_put_innovations(model)
    put_surprise = make_put_surprise(model)

    @kernel
    def improve_row(
        steps: Records,
        left: int,
        row: Records,
        terms: Records,
        own: Own,
        given: Given,
        recent: int,
        iterations: int,
    ) -> bool:
        """Take Gauss-Newton steps of a row; return True if it still changes, False once converged or lost."""
        surface = given.surface
        work = given.work[0]
        first_recent = max(len(steps) - recent, 0)
        first = 0
        is_changing = True
        for _ in range(iterations):
            for k in range(first, len(steps)):
                model.prepare_step(steps[k], surface)
            is_found = eliminate_steps(steps, first, first_recent, left, row, terms, own, given)
            row.is_lost = not (is_found and move(steps, first_recent, row, work.change))
            is_changing = not row.is_lost and row.change >= CONVERGED
            if not is_changing:
                break
            first = first_recent if row.earlier_change < FAR else 0
            for k in range(first):
                steps[k].y[:] = 0.0  # their own gradient is spent: from here on they follow the next step
        if not row.is_lost:
            model.prepare_step(steps[len(steps) - 1], surface)
            model.prepare_last(steps, row, given.settings[0])
            put_process_innovations(steps, row, given)
            put_object(steps[len(steps) - 1], row, work)
            put_innovations(steps, left, row, terms, own, given)
            put_surprise(steps, left, row)
        return is_changing

    return improve_row


def make_eliminate_steps(model: Functions) -> Any:
    """Return the compiled function of a model that linearises all factors and eliminates all numbers."""
    begin_with_past = make_begin_with_past(model)
    write_past = make_write_past(model)
    add_pairs = make_add_pairs(model)
    add_singles = make_add_singles(model)
    add_measured = make_add_measured(model)

    @kernel
    def eliminate_steps(
        steps: Records, first: int, first_recent: int, left: int, row: Records, terms: Records, own: Own, given: Given
    ) -> bool:
        """Linearise all factors and eliminate all numbers, oldest step first; False if they are indeterminate.

        It begins with the step `first`: the oldest one or, once that was so, the first recent one.
        """
        work = given.work[0]
        work.system[:] = 0.0
        work.gradient[:] = 0.0
        begin_with_past(steps[first], row, work.earlier if first > 0 else row.past, work)
        t = 0
        while t < len(terms) and terms[t].step < left + first:
            t += 1
        for k in range(first, len(steps)):
            now = steps[k]
            before = steps[max(k - 1, 0)]
            now.cost[:2] = 0.0
            now.cost_of_belief = 0.0
            model.prepare_process(steps, k, row, given.settings[0])
            if k > first:
                model.elimination.move_into_past(work.system, work.gradient)
                add_pairs(before, now, row, given)
            if k == 1 and first == 0:
                write_past(now, row, row.next_past, work)
                inflate(given.drift, row.next_past.information, row.next_past.gradient, work.change)
            if k == first_recent and k > first:
                write_past(now, row, work.earlier, work)
            add_singles(now, left + k == 0, row, given)
            t = add_measured(now, left + k, row, terms, t, own, given)
            if k > first and not model.elimination.eliminate_step(work.system, work.gradient, before.root, before.y):
                return False
        return model.elimination.eliminate_last(work.system, work.gradient, row.last_root, row.last_y)

    return eliminate_steps


def make_add_pairs(model: Functions) -> Any:
    """Return the compiled function of a model that adds the factors of a pair of steps to the system."""
    add = make_add(2 * model.step_size + model.shared_size)

    @kernel
    def add_pairs(before: Records, now: Records, row: Records, given: Given) -> None:
        """Linearise and add the factors of a step and the one before."""
        work = given.work[0]
        for kind in range(model.pairs):
            count = model.linearise_step(kind, before, now, row, given.settings[0], work.linear)
            add(model.roles[kind], count, work.linear, now, work.system, work.gradient)

    return add_pairs


def make_add_singles(model: Functions) -> Any:
    """Return the compiled function of a model that adds the factors of one step, but for measured ones."""
    add = make_add(2 * model.step_size + model.shared_size)

    @kernel
    def add_singles(now: Records, is_first: bool, row: Records, given: Given) -> None:
        """Linearise and add the factors of a step; some are of the first step of a contact alone."""
        work = given.work[0]
        for kind in range(model.pairs, model.step_factors):
            if is_first or not model.is_first[kind]:
                count = model.linearise_step(kind, now, now, row, given.settings[0], work.linear)
                add(model.roles[kind], count, work.linear, now, work.system, work.gradient)

    return add_singles


def make_add_measured(model: Functions) -> Any:
    """Return the compiled function of a model that adds the factors of a step's measurements."""
    add = make_add(2 * model.step_size + model.shared_size)

    @kernel
    def add_measured(now: Records, number: int, row: Records, terms: Records, t: int, own: Own, given: Given) -> int:
        """Linearise and add the terms of a step of this number, from the t-th on; return the place of the next one."""
        work = given.work[0]
        while t < len(terms) and terms[t].step == number:
            kind = int(terms[t].kind)
            count = model.linearise_measured(kind, now, row, terms[t], given.settings[0], given.places, work.linear)
            add(model.roles[kind], count, work.linear, now, work.system, work.gradient)
            t += 1
        for m in range(len(own[0])):
            if own[0][m] == number:
                count = copy_own(model.step_size, own[1][m], work.linear)
                add(MEASUREMENT, count, work.linear, now, work.system, work.gradient)
        return t

    return add_measured


def make_begin_with_past(model: Functions) -> Any:
    """Return the compiled function of a model that writes what the steps before one say about it."""

    @kernel
    def begin_with_past(now: Records, row: Records, past: Records, work: Records) -> None:
        """Write what the steps before one, its `past`, say about it and the shared variables."""
        system = work.system
        gradient = work.gradient
        change = work.change
        first = model.step_size
        size = model.step_size + model.shared_size
        model.difference(past, now, work.linear.error, change)
        for i in range(model.shared_size):
            change[first + i] = row.shared[i] - past.shared[i]
        for i in range(size):
            gradient[first + i] = past.gradient[i]
            for j in range(size):
                gradient[first + i] -= past.information[i, j] * change[j]
                system[first + i, first + j] = past.information[i, j]

    return begin_with_past


def make_write_past(model: Functions) -> Any:
    """Return the compiled function of a model that keeps what the steps before one say about it."""

    @kernel
    def write_past(now: Records, row: Records, past: Records, work: Records) -> None:
        """Keep what the steps before one say about it as its `past`; all their factors are in the system."""
        work.next_system = work.system
        work.next_gradient = work.gradient
        system = work.next_system
        gradient = work.next_gradient
        first = model.step_size
        size = model.step_size + model.shared_size
        is_found = model.elimination.eliminate_step(system, gradient, work.next_root, work.next_y)
        model.copy_step(now, past)
        past.shared = row.shared
        for i in range(size):
            past.gradient[i] = gradient[first + i] if is_found else math.nan
            for j in range(i, size):
                value = system[first + i, first + j] if is_found else math.nan
                past.information[i, j] = value
                past.information[j, i] = value

    return write_past


@cache
def make_add(width: int) -> Any:
    """Return the compiled function that adds the rows of a factor to a system of this width."""

    @partial(kernel, are_disjoint=True)
    def add(role: int, count: int, out: Records, now: Records, system: Array, gradient: Array) -> None:
        """Add the rows of a factor to the system and their costs to those of the step, and clear them.

        They are added in full, which is quicker than to the upper triangle.
        The cost is half the square of each row, reduced by its kernel. A Cauchy kernel of scale k gives a square s the
        weight w = 1 / (1 + s / k^2) and the cost k^2 log(1 + s / k^2) / 2, which is -s w / (1 - w) log(w) / 2. The
        costs of several rows under one kernel add up to this.
        """
        for r in range(count):
            row = out.jacobian[r]
            weight = out.weight[r]
            residual = out.residual[r]
            for i in range(width):
                if row[i] != 0.0:
                    pull = weight * row[i]
                    gradient[i] -= pull * residual
                    for j in range(width):
                        system[i, j] += pull * row[j]
            row[:] = 0.0
            square = out.information[r] * residual**2
            if role == BELIEF:
                now.cost_of_belief += 0.5 * square
                continue
            if not out.information[r] > 0.0:
                continue
            left = weight / out.information[r]
            if left < _FULL_WEIGHT:
                square *= -left / (1.0 - left) * math.log(left)
            now.cost[1 if role == PROCESS else 0] += 0.5 * square

    return add


def make_move(model: Functions) -> Any:
    """Return the compiled function of a model that moves all values."""

    @kernel
    def move(steps: Records, first_recent: int, row: Records, change: Array) -> bool:
        """Move all values, newest step first; False if a change is not finite. `change` (width,) is room."""
        size = model.step_size
        largest = 0.0
        total = 0.0
        row.earlier_change = 0.0
        model.elimination.back_from_last(row.last_root, row.last_y, change)
        for i in range(model.shared_size):
            row.shared[i] += change[2 * size + i]
        for i in range(size + model.shared_size):
            row.moved[i] = change[size + i]
        for k in range(len(steps) - 1, -1, -1):
            now = steps[k]
            model.move_step(now, change[size:])
            for i in range(size, 2 * size):
                largest = max(largest, abs(change[i]))
                if k < first_recent:
                    row.earlier_change = max(row.earlier_change, abs(change[i]))
                total += change[i]  # which is not finite if one of them is not
            if k > 0:
                model.elimination.back_from_step(steps[k - 1].root, steps[k - 1].y, change)
                for i in range(size):
                    change[size + i] = change[i]
        row.change = largest
        return math.isfinite(total)

    return move


def make_put_object(model: Functions) -> Any:
    """Return the compiled function of a model that writes the pose of the object and its covariance."""

    @kernel
    def put_object(last: Records, row: Records, work: Records) -> None:
        """Write the object's last pose, and the joint covariance of this and its variables."""
        out = work.linear
        first = model.step_size
        size = len(row.covariance)
        width = len(work.gradient)
        model.put_object_pose(last, row.object)
        model.put_object_derivative(last, out.jacobian, first)
        for i in range(size):
            derivative = out.jacobian[i]
            if i >= 3:
                derivative[width - size + i] = 1.0
            model.elimination.forward_last(row.last_root, derivative)
            for j in range(i + 1):
                product = 0.0
                for k in range(first, width):
                    product += derivative[k] * out.jacobian[j, k]
                row.covariance[i, j] = product
                row.covariance[j, i] = product
        out.jacobian[:] = 0.0

    return put_object
