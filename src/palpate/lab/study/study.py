"""A study: every recording of a folder, tracked in every way, on several cores, and resumable."""

import logging
import sys
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from palpate.files import held_folder
from palpate.lab.study.folder import StudyFolder
from palpate.lab.study.job import Job, Outcome, StudySettings, do_job
from palpate.lab.study.trial import Method, Trial
from palpate.parallel import spread
from palpate.shards import Shard, part_of_work
from palpate.touch.model import TouchModel
from palpate.tracker_arguments import first_pose_of

logger = logging.getLogger(__name__)
DIED = "the process that tracked it died, which a lack of memory may explain"


@dataclass(frozen=True)
class Study:
    """What became of all recordings."""

    trials: tuple[Trial, ...]
    """In the order of recordings, then of methods."""
    recordings: dict[str, dict[str, Any]]
    """Facts of each recording that could be read; see `job.Outcome`."""
    skipped: dict[tuple[str, Method], str]
    """Recordings that cannot be tracked in this way, and why."""
    failed: dict[tuple[str, Method], str]
    """Those whose tracking did not go to its end, and why."""
    broken: dict[str, str]
    """Those that cannot be read, and why."""
    kept: int
    """Trials that were there already."""
    wall_s: float
    """Time of it all [s]."""


def run_study(
    files: Mapping[str, Path],
    out: Path,
    settings: StudySettings,
    model: TouchModel | None = None,
    workers: int = 1,
    dask: str | None = None,
    resume: bool = False,
    progress: Callable[[int], None] | None = None,
    shard: Shard | None = None,
) -> Study:
    """Track recordings, by name as `files.find_recordings` gives them, and write each trial to a folder.

    `model` is that of learnt touch, by default the one of each recording's sensor. `workers` and `dask` are those of
    `parallel.spread`; a cluster has to see the files under the same paths. Trials that are there are kept if `resume`,
    and otherwise an error. `progress` is called with the number of trials that are done, of one for each recording and
    method. Of a shard only its own recordings are tracked; other processes may be at the others meanwhile, and one
    without a shard that resumes puts all together. Raises SettingError on values that are not allowed and on a folder
    made with others, FileError where the folder cannot be written.
    """
    begin = time.perf_counter()
    for method in settings.methods:
        first_pose_of(settings.first_pose, settings.first_pose_sigma, settings.tracker(method))
    files = dict(part_of_work(tuple(files.items()), shard))
    with held_folder(out, str(shard or "")):
        folder = StudyFolder(out, settings, model, resume, shard)
        trials: dict[tuple[str, Method], Trial] = {}
        todo: list[Job] = []
        for name, path in files.items():
            job = Job(name, path.resolve(), settings.methods)
            there = folder.kept(job)
            trials |= {(name, method): trial for method, trial in there.items()}
            if rest := tuple(method for method in settings.methods if method not in there):
                todo.append(replace(job, methods=rest))
        kept = done = len(trials)
        skipped: dict[tuple[str, Method], str] = {}
        failed: dict[tuple[str, Method], str] = {}
        broken: dict[str, str] = {}
        with closing(_outcomes(partial(do_job, settings=settings, model=model), todo, workers, dask)) as outcomes:
            for outcome in outcomes:
                name = outcome.job.name
                folder.add(outcome)
                trials |= {(name, trial.method): trial for trial in outcome.trials}
                skipped |= {(name, method): why for method, why in outcome.skipped.items()}
                failed |= {(name, method): why for method, why in outcome.failed.items()}
                if outcome.broken is not None:
                    broken[name] = outcome.broken
                done += len(outcome.job.methods)
                if progress:
                    progress(done)
    order = [(name, method) for name in files for method in settings.methods]
    return Study(
        trials=tuple(trials[each] for each in order if each in trials),
        recordings={name: facts for name in files if (facts := folder.facts(name)) and name not in broken},
        skipped={each: skipped[each] for each in order if each in skipped},
        failed={each: failed[each] for each in order if each in failed},
        broken={name: broken[name] for name in files if name in broken},
        kept=kept,
        wall_s=time.perf_counter() - begin,
    )


def _outcomes(
    do: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, dask: str | None
) -> Generator[Outcome, None, None]:
    """Yield what becomes of jobs, in no order, and go on where a process dies.

    Its death takes the others along and does not tell which job it was at. So those that were under way are done again
    one by one, in processes of their own, and the one that kills its process again has failed.
    """
    waiting = list(jobs)
    while waiting:
        begun: list[Job] = []
        done: set[str] = set()
        try:
            with closing(spread(do, _noted(waiting, begun), workers, dask)) as outcomes:
                for outcome in outcomes:
                    done.add(outcome.job.name)
                    yield outcome
        except Exception as error:
            if not _is_death(error):
                raise
            suspects = [job for job in begun if job.name not in done]
            logger.warning("a process died; doing the %d recordings again that were under way", len(suspects))
            for job in suspects:
                yield _alone(do, job, dask)
                done.add(job.name)
        waiting = [job for job in waiting if job.name not in done]


def _alone(do: Callable[[Job], Outcome], job: Job, dask: str | None) -> Outcome:
    try:
        with closing(spread(do, [job], 2, dask)) as outcomes:  # with one worker it would be this process
            return next(outcomes)
    except Exception as error:
        if not _is_death(error):
            raise
        return Outcome(job, failed=dict.fromkeys(job.methods, DIED))


def _noted(jobs: Sequence[Job], begun: list[Job]) -> Iterator[Job]:
    for job in jobs:
        begun.append(job)
        yield job


def _is_death(error: Exception) -> bool:
    """Whether a worker has died, here or on a cluster."""
    distributed = sys.modules.get("distributed")
    return isinstance(error, BrokenExecutor) or (
        distributed is not None and isinstance(error, distributed.KilledWorker)
    )
