"""Innovations: measured less predicted, of each factor of the last step, and how surprising the last steps were."""

from typing import Any

from palpate.arrays import Records
from palpate.compiled import kernel
from palpate.estimation.compiled_model import Functions, Given, Own, copy_own

JUDGED_STEPS = 5
"""Steps over which innovations are judged: more steps find no more disturbances."""
LEAST_PREDICTED = 1e-4
"""Least share of R in R + H P H' from which a measurement is predicted at all."""


def make_put_process_innovations(model: Functions) -> Any:
    """Return the compiled function of a model that writes the innovations of the process."""

    @kernel
    def put_process_innovations(steps: Records, row: Records, given: Given) -> None:
        """Write the residuals of the factors of the last pair of steps once all is fused, in place of innovations."""
        settings = given.settings[0]
        out = given.work[0].linear
        last = len(steps) - 1
        now = steps[last]
        row.innovations[: model.step_factors] = 0.0
        now.surprise[:] = 0.0
        if last == 0:
            return
        for kind in range(model.pairs):
            count = model.linearise_step(kind, steps[last - 1], now, row, settings, out)
            for r in range(count):
                if model.is_compared[kind]:
                    row.innovations[kind, r, 0] = out.residual[r]
                    row.innovations[kind, r, 2] = 1.0 / out.information[r]
                    now.surprise[kind] += out.information[r] * out.residual[r] ** 2
                out.jacobian[r] = 0.0

    return put_process_innovations


def make_put_innovations(model: Functions) -> Any:
    """Return the compiled function of a model that writes the innovations of measurements."""
    put_innovation = make_put_innovation(model)

    @kernel
    def put_innovations(steps: Records, left: int, row: Records, terms: Records, own: Own, given: Given) -> None:
        """Write the innovations of the last step's factors and own measurements, and of terms that arrived with it."""
        settings = given.settings[0]
        out = given.work[0].linear
        last = len(steps) - 1
        row.innovations[model.pairs :] = 0.0
        for kind in range(model.pairs, model.step_factors):
            if not model.is_first[kind]:
                count = model.linearise_step(kind, steps[last], steps[last], row, settings, out)
                put_innovation(kind, last, count, 0.0, steps, row, out)
        for t in range(len(terms)):
            if terms[t].arrived == left + last:
                k = int(terms[t].step) - left
                kind = int(terms[t].kind)
                count = model.linearise_measured(kind, steps[k], row, terms[t], settings, given.places, out)
                put_innovation(kind, k, count, terms[t].variance, steps, row, out)
        for m in range(len(own[0])):
            if own[0][m] == left + last:
                count = copy_own(model.step_size, own[1][m], out)
                for r in range(count):  # its residual is from before the last Gauss-Newton step
                    for i in range(len(row.moved)):
                        out.residual[r] += out.jacobian[r, model.step_size + i] * row.moved[i]
                put_innovation(model.factors, last, count, 0.0, steps, row, out)

    return put_innovations


def make_put_innovation(model: Functions) -> Any:
    """Return the compiled function of a model that writes the innovations of one factor."""

    @kernel
    def put_innovation(
        kind: int,
        k: int,
        count: int,
        stated: float,
        steps: Records,
        row: Records,
        out: Records,
    ) -> None:
        """Write the innovations of the linearised rows of a factor of step k, and clear these.

        The residual r once all is fused, and the variance a = H P H' that is left of it, give the innovation
        r R / (R - a) before the row was fused with variance R, and the variance a R / (R - a) of what was predicted.
        There is none where nothing else predicts the row. A `stated` variance of 0 stands for that of the settings.
        """
        size = model.step_size
        surprise = steps[len(steps) - 1].surprise
        for r in range(count):
            jacobian = out.jacobian[r]
            variance = 0.0
            for j in range(k, len(steps) - 1):
                for i in range(size):
                    jacobian[i] = jacobian[size + i]
                    jacobian[size + i] = 0.0
                variance += model.elimination.forward_step(steps[j].root, jacobian)
            variance += model.elimination.forward_last(row.last_root, jacobian)
            jacobian[:] = 0.0
            share = 1.0 - variance * out.weight[r]
            innovation = row.innovations[kind, r]
            if share > LEAST_PREDICTED:
                innovation[0] = out.residual[r] / share
                innovation[1] = variance / share
                innovation[2] = stated if stated > 0.0 else 1.0 / out.information[r]
                surprise[kind] += innovation[0] ** 2 / (innovation[1] + 1.0 / out.information[r])

    return put_innovation


def make_put_surprise(model: Functions) -> Any:
    """Return the compiled function of a model that judges the innovations of the last steps."""

    @kernel
    def put_surprise(steps: Records, left: int, row: Records) -> None:
        """Write the mean squared innovations of the last steps; see `estimation.records.row_type`."""
        first = len(steps) - JUDGED_STEPS
        for kind in range(model.factors + 1):
            row.surprise[kind] = 0.0
            if left + first >= 0:
                for k in range(max(first, 0), len(steps)):
                    row.surprise[kind] += steps[k].surprise[kind] / JUDGED_STEPS

    return put_surprise
