"""The touch network: differences from the untouched gel, (B, 3, 32, 128), to means and log variances; its ONNX file."""

import logging
import warnings
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.errors import EstimationError
from palpate.touch.touch_model import COLUMNS, ROWS, SIZES, session

MAP = (ROWS // 4, COLUMNS // 4)
"""Rows and columns of the feature map."""
WIDTH = 16
"""Channels of the encoder. ONNX Runtime takes sixteen at a time: 24 cost as much as 32."""
_POINTS = 4  # key points
_REDUCED = 8  # channels of the map that the layers below read
_HIDDEN = 64  # values that all outputs share


class Encoder(nn.Module):
    """A small ResNet-18 (paper Sec. IV-A): three stages of two blocks on a map of 8 x 32, a quarter of an image."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, WIDTH, 7, stride=2, padding=3, bias=False),
            nn.BatchNorm2d(WIDTH),
            nn.ReLU(),
            nn.MaxPool2d(3, stride=2, padding=1),
            *(_Block() for _ in range(6)),
        )

    def forward(self, difference: Tensor) -> Tensor:
        """Return the feature map (B, WIDTH, 8, 32) of the imprint."""
        return self.layers(imprint(difference))


class _Block(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1, bias=False),
            nn.BatchNorm2d(WIDTH),
            nn.ReLU(),
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1, bias=False),
            nn.BatchNorm2d(WIDTH),
        )

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.layers(x))


class TouchNetwork(nn.Module):
    """An image to the outputs of a touch model, each (B, 2), of a corner (B, 4); see `touch.touch_model`."""

    def __init__(self, outputs: Sequence[str]) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.points = nn.Conv2d(WIDTH, _POINTS, 1)
        self.reduce = nn.Conv2d(WIDTH, _REDUCED, 1)
        inputs = _REDUCED * 2 * MAP[1] + 2 * _POINTS
        self.body = nn.Sequential(nn.Linear(inputs, 2 * _HIDDEN), nn.ReLU(), nn.Linear(2 * _HIDDEN, _HIDDEN), nn.ReLU())
        self.outputs = tuple(outputs)
        for name in self.outputs:
            self.add_module(name, nn.Linear(_HIDDEN + 2 * _POINTS, SIZES.get(name, 2)))

    def forward(self, difference: Tensor) -> tuple[Tensor, ...]:
        """Return the outputs in their order."""
        features = self.encoder(difference)
        points = keypoint(nn.functional.softplus(self.points(features))).flatten(1)
        coarse = nn.functional.avg_pool2d(torch.relu(self.reduce(features)), (MAP[0] // 2, 1)).flatten(1)
        body = torch.cat([self.body(torch.cat([coarse, points], dim=1)), points], dim=1)
        return tuple(gaussian(self.get_submodule(name)(body)) for name in self.outputs)


class Together(nn.Module):
    """Networks of one output as one, which gives mean and log variance of the mixture of what they predict."""

    def __init__(self, networks: Sequence[TouchNetwork]) -> None:
        super().__init__()
        self.networks = nn.ModuleList(networks)
        self.outputs = networks[0].outputs

    def forward(self, difference: Tensor) -> tuple[Tensor]:
        """Return the output, (B, 2)."""
        mean, log_variance = torch.stack([network(difference)[0] for network in self.networks]).unbind(dim=-1)
        variance = log_variance.exp().mean(dim=0) + mean.var(dim=0, correction=0)
        return (torch.stack([mean.mean(dim=0), variance.log()], dim=1),)


def imprint(difference: Tensor) -> Tensor:
    """Return differences (B, 3, H, W) without faint surroundings: there the light wandered or the gel gave way.

    Simulation knows too little of that, and networks that see it read much into it on real gels. Differences of 0.2 (6
    grey levels) within 3 rows and 13 columns, about 2 mm of a DIGIT, count by half.
    """
    strength = difference.abs().mean(dim=1, keepdim=True)
    above = torch.from_numpy(_near(difference.shape[2], reach=1)).to(difference.device)
    beside = torch.from_numpy(_near(difference.shape[3], reach=6)).to(difference.device)
    # Products with matrices, as ONNX Runtime takes four times as long to pool.
    strength = torch.matmul(above, strength) / above.sum(dim=1, keepdim=True)
    strength = torch.matmul(strength, beside) / beside.sum(dim=0, keepdim=True)
    fourth = (strength / 0.2) ** 4
    return difference * (fourth / (fourth + 1.0))


def _near(count: int, reach: int) -> NDArray[np.float32]:
    """Return a matrix (count, count) of ones where row and column are at most so far apart."""
    places = np.arange(count)
    return (np.abs(places[:, None] - places) <= reach).astype(np.float32)


def keypoint(activation: Tensor) -> Tensor:
    """Return the centres (B, K, 2) of positive maps (B, K, H, W): column and row, from -1 to 1."""
    height, width = activation.shape[-2:]
    total = activation.sum(dim=(2, 3)) + 1e-6
    across = cell_centres(width).to(activation.device)
    down = cell_centres(height).to(activation.device)
    column = (activation.sum(dim=2) * across).sum(dim=2) / total
    row = (activation.sum(dim=3) * down).sum(dim=2) / total
    return torch.stack([column, row], dim=-1)


def gaussian(output: Tensor) -> Tensor:
    """Return outputs (B, 2 or more) whose second, a log variance, keeps that of the deviation [rad] from -6 to 1."""
    middle = -5.0  # of the log variance
    half = 7.0
    return torch.cat([output[:, :1], middle + half * torch.tanh(output[:, 1:2] / half), output[:, 2:]], dim=1)


def cell_centres(count: int) -> Tensor:
    """Return the centres (count,) of as many equal cells from -1 to 1."""
    return torch.from_numpy((np.arange(count, dtype=np.float32) + np.float32(0.5)) * np.float32(2.0 / count) - 1)


def exported(network: TouchNetwork | Together, close: float = 1e-4) -> bytes:
    """Return a touch network as an ONNX file, checked to give the same outputs as in torch, within `close`.

    Weights keep their names, so that `restore` finds them. Raises EstimationError where outputs differ.
    """
    network = _with_biases(network.eval())
    image = torch.randn(1, 3, ROWS, COLUMNS)
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network,
            (image,),
            input_names=["difference"],
            output_names=list(network.outputs),
            dynamo=True,
            optimize=False,
            external_data=False,
            verbose=False,
        )
    assert program is not None
    file = _without_notes(program.model_proto)
    outputs = session(file).run(None, {"difference": image.numpy()})
    with torch.no_grad():
        worst = max(float(np.abs(a - b.numpy()).max()) for a, b in zip(outputs, network(image), strict=True))
    if not worst < close:
        raise EstimationError(f"ONNX Runtime differs from torch by {worst:.2g}; {close} is allowed")
    return file


def restore(network: nn.Module, file: bytes) -> None:
    """Set a network's weights to those of its ONNX file; EstimationError if they do not fit it."""
    import onnx
    from onnx import numpy_helper

    written = {weights.name: weights for weights in onnx.load_from_string(file).graph.initializer}
    for name, value in network.state_dict().items():
        if name.endswith("num_batches_tracked"):
            continue
        if name not in written or list(written[name].dims) != list(value.shape):
            raise EstimationError(f"the model's network has no weights {name} {tuple(value.shape)}")
        value.copy_(torch.from_numpy(numpy_helper.to_array(written[name]).copy()))


def _with_biases(network: TouchNetwork | Together) -> TouchNetwork | Together:
    """Return a copy in which every convolution has a bias, so that ONNX Runtime folds the batch normalisation into it.

    The weights themselves are not folded, for training may continue from them.
    """
    other = deepcopy(network)
    for part in other.modules():
        if isinstance(part, nn.Conv2d) and part.bias is None:
            part.bias = nn.Parameter(torch.zeros(part.out_channels))
    return other


def _without_notes(model: Any) -> bytes:
    """Return a model's file without the exporter's notes on every node, such as source lines and paths."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        del part.metadata_props[:]
    del graph.value_info[:]
    return model.SerializeToString()
