"""The laboratory's commands; what they do is imported where it is done, so that `--help` stays fast."""

from palpate_lab.commands.demo import demo
from palpate_lab.commands.recordings import simulate, truth, truth_camera, truth_print
from palpate_lab.commands.study import compare, evaluate, paper, train, tune

__all__ = ["compare", "demo", "evaluate", "paper", "simulate", "train", "truth", "truth_camera", "truth_print", "tune"]
