"""Write the networks of models anew, with the same weights, after their graph in `palpate_lab.train.networks` changed.

python scripts/export_models.py [FOLDER ...]    # by default the models that come with palpate
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from palpate.errors import EstimationError
from palpate.touch.touch_model import COLUMNS, ROWS, SHIPPED_OF, TouchModel, session
from palpate_lab.train.networks import TouchNetwork, exported, restore
from palpate_lab.train.train import write_model

CLOSE = 1e-5
"""Largest difference between an output before and after."""


def main() -> None:
    """Write the models whose outputs stay as they were; EstimationError on the first whose do not."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("folder", nargs="*", type=Path, default=list(SHIPPED_OF.values()))
    for folder in parser.parse_args().folder:
        model = TouchModel(folder)
        network = TouchNetwork(tuple(model.settings.spread))
        with torch.no_grad():
            restore(network, model.network)
        file = exported(network)
        worst = difference(model.network, file)
        if not worst < CLOSE:
            raise EstimationError(f"{folder}: outputs differ by {worst:.2g}; {CLOSE:g} is allowed")
        write_model(folder, model.settings, file)
        print(f"{folder}: outputs differ by {worst:.2g}")


def difference(before: bytes, after: bytes, count: int = 200) -> float:
    """Return the largest difference between the outputs of two networks, for inputs from faint to strong."""
    random = np.random.default_rng(0)
    networks = session(before), session(after)
    worst = 0.0
    for strength in np.geomspace(0.01, 3.0, count):
        image = random.normal(0.0, strength, (1, 3, ROWS, COLUMNS)).astype(np.float32)
        outputs, others = (network.run(None, {"difference": image}) for network in networks)
        worst = max(worst, *(float(np.abs(a - b).max()) for a, b in zip(outputs, others, strict=True)))
    return worst


if __name__ == "__main__":
    main()
