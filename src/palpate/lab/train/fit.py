"""Gradient descent: one loop for all networks, with log, early stop, and a checkpoint to go on from."""

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.errors import EstimationError, FileError
from palpate.files import whole_file

Losses = Mapping[str, Tensor]
Batch = tuple[NDArray[np.int_], Any]
"""Which samples were drawn, and the tensors that losses take of them."""


@dataclass(frozen=True)
class FitSettings:
    """How long and how fast to descend."""

    steps: int
    """Most steps."""
    rate: float = 3e-3
    """Largest learning rate; it rises at the beginning and falls to nothing at the end."""
    check: int = 100
    """Steps from one look at the held-out recordings to the next."""
    patience: int = 15
    """Looks without a better loss after which to stop. The loss is restless while the rate is large."""


def fit(
    name: str,
    network: nn.Module,
    draw: Callable[[np.random.Generator], Batch],
    losses: Callable[[Batch], Losses],
    held_out: Callable[[], Losses],
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> None:
    """Make the sum of losses small; the network is left as it was when those of the held-out recordings were least.

    `draw` draws a batch, `losses` returns the losses on it, `held_out` those on recordings not trained on. `folder`
    takes the log `<name>.csv` and the checkpoint `<name>.pt`, from which a run that was cut off goes on. Raises
    EstimationError where a loss is not finite, with the batch and the network before that step in `<name>-failed.pt`,
    and FileError on a checkpoint of something else.
    """
    optimiser = torch.optim.AdamW(network.parameters(), lr=settings.rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.rate, total_steps=settings.steps)
    checkpoint = folder / f"{name}.pt"
    best, waited, begin = math.inf, 0, 0
    best_state = {key: value.clone() for key, value in network.state_dict().items()}
    if checkpoint.exists():
        saved = _load(
            checkpoint, seed, settings.steps, {"network": network, "optimiser": optimiser, "schedule": schedule}
        )
        best, waited, begin, best_state = (saved[key] for key in ("best", "waited", "step", "best_state"))
    with _log(folder / f"{name}.csv", begin) as write:
        for step in range(begin, settings.steps):
            if waited >= settings.patience:
                break
            network.train()
            # Each step has a generator of its own, so that a run that goes on draws what it would have drawn.
            batch = draw(np.random.default_rng([seed, step]))
            found = losses(batch)
            total = torch.stack(list(found.values())).sum()
            if not torch.isfinite(total):
                _fail(name, step, found, network, batch, folder / f"{name}-failed.pt")
            optimiser.zero_grad()
            total.backward()
            nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimiser.step()
            schedule.step()
            if (step + 1) % settings.check == 0 or step + 1 == settings.steps:
                network.eval()
                with torch.no_grad():
                    checked = {key: float(value) for key, value in held_out().items()}
                write(step + 1, {key: float(value.detach()) for key, value in found.items()}, checked)
                if not math.isfinite(sum(checked.values())):
                    held = f"{name} on what was held out"
                    _fail(held, step, held_out(), network, batch, folder / f"{name}-failed.pt")
                waited += 1
                if sum(checked.values()) < best:
                    best, waited = sum(checked.values()), 0
                    best_state = {key: value.clone() for key, value in network.state_dict().items()}
                state = {"network": network.state_dict(), "optimiser": optimiser.state_dict()}
                state |= {"schedule": schedule.state_dict(), "best": best, "best_state": best_state}
                _save(state | {"waited": waited, "step": step + 1, "seed": seed}, checkpoint)
                if progress:
                    progress(step + 1, ", ".join(f"{key} {value:.3g}" for key, value in checked.items()))
    network.load_state_dict(best_state)
    network.eval()


def _save(state: Mapping[str, Any], path: Path) -> None:
    data = io.BytesIO()  # in memory first: on a full disk torch raises an error that says nothing of it
    torch.save(state, data)
    with whole_file(path, overwrite=True) as part:
        part.write_bytes(data.getvalue())


def _load(checkpoint: Path, seed: int, steps: int, states: Mapping[str, Any]) -> dict[str, Any]:
    try:
        saved = torch.load(checkpoint, weights_only=True)
        begun = {"seed": saved.get("seed", seed), "steps": saved["schedule"]["total_steps"]}
        for name, what in states.items():
            what.load_state_dict(saved[name])
    except Exception as error:  # torch raises many kinds, from zip files to unpickling and weights that do not fit
        raise FileError(f"{checkpoint}: is not a checkpoint that can be gone on from ({error})") from error
    # Which recordings are held out depends on the seed, and how the rate falls on the steps.
    for what, wanted in (("seed", seed), ("steps", steps)):
        if begun[what] != wanted:
            raise FileError(
                f"{checkpoint}: was begun with {what} {begun[what]}, going on with {what} {wanted} would mix the two"
            )
    return saved


def _fail(name: str, step: int, found: Losses, network: nn.Module, batch: Batch, path: Path) -> None:
    chosen, seen = batch
    seen = asdict(seen) if is_dataclass(seen) and not isinstance(seen, type) else seen
    _save({"network": network.state_dict(), "step": step, "chosen": torch.from_numpy(chosen), "batch": seen}, path)
    losses = ", ".join(f"{key} {float(value.detach()):g}" for key, value in found.items())
    raise EstimationError(
        f"training of {name} at step {step}: {losses}; losses must be finite. The batch and the network before "
        f"the step are in {path}"
    )


@contextmanager
def _log(path: Path, begin: int) -> Iterator[Callable[[int, Mapping[str, float], Mapping[str, float]], None]]:
    """Open the log: a row for each look, with the losses of its batch and of the held-out recordings.

    Of a run that goes on at a step, the rows up to that step stay.
    """
    rows = _rows(path, begin)
    with whole_file(path, overwrite=True) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)

        def write(step: int, batch: Mapping[str, float], held_out: Mapping[str, float]) -> None:
            if file.tell() == 0:
                writer.writerow(["step", *(f"batch_{key}" for key in batch), *(f"held_out_{key}" for key in held_out)])
            writer.writerow([step, *batch.values(), *held_out.values()])
            file.flush()

        yield write


def _rows(path: Path, last: int) -> list[list[str]]:
    """The head and the rows of a log up to a step; none where the run begins."""
    if not last or not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return [head, *(row for row in rows if len(row) == len(head) and int(row[0]) <= last)]
