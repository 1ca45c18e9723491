"""The touch network: differences from the untouched gel, (B, 3, 32, 128), to means and log variances; its ONNX file."""

import logging
import warnings
from collections.abc import Sequence
from copy import deepcopy
from itertools import accumulate
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
_FAINT = 0.2
"""Difference that counts by half, see `imprint`."""


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
        # One product for all outputs, as each node of a small network costs ONNX Runtime more than its numbers.
        heads = [self.get_submodule(name) for name in self.outputs]
        weight = torch.cat([head.get_parameter("weight") for head in heads])
        bias = torch.cat([head.get_parameter("bias") for head in heads])
        return gaussian(nn.functional.linear(body, weight, bias), [len(head.get_parameter("bias")) for head in heads])


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
    channels, rows, columns = difference.shape[1:]
    # Products with matrices, as ONNX Runtime takes four times as long to pool; the first also sums the channels.
    above = np.tile(_mean_near(rows, reach=1), channels) / channels
    beside = _mean_near(columns, reach=6).T
    strength = torch.matmul(_constant(above, difference), difference.abs().flatten(1, 2))
    strength = torch.matmul(strength, _constant(beside / _FAINT, difference)).unsqueeze(1)
    square = strength * strength  # not a power, which takes five times as long
    fourth = square * square
    return difference * (fourth / (fourth + 1.0))


def _mean_near(count: int, reach: int) -> NDArray[np.float32]:
    """Return the matrix (count, count) that takes means over places at most so far apart."""
    places = np.arange(count)
    are_near = (np.abs(places[:, None] - places) <= reach).astype(np.float32)
    return are_near / are_near.sum(axis=1, keepdims=True)


def _constant(values: NDArray[Any], like: Tensor) -> Tensor:
    """Return values as a tensor of the type of another, on its device."""
    return torch.from_numpy(values).to(like)


def keypoint(activation: Tensor) -> Tensor:
    """Return the centres (B, K, 2) of positive maps (B, K, H, W): column and row, from -1 to 1."""
    height, width = activation.shape[-2:]
    row, column = np.meshgrid(cell_centres(height), cell_centres(width), indexing="ij")
    summands = np.stack([column, row, np.ones_like(row)], axis=-1).reshape(-1, 3)
    sums = torch.matmul(activation.flatten(2), _constant(summands, activation))
    return sums[..., :2] / (sums[..., 2:] + 1e-6)


def gaussian(outputs: Tensor, sizes: Sequence[int]) -> tuple[Tensor, ...]:
    """Return outputs (B, sum of sizes) one by one, the second value of each in the range of a log variance.

    The logarithm of the deviation [rad] is kept from -6 to 1.
    """
    middle = -5.0  # of the log variance
    half = 7.0
    is_log_variance = torch.tensor([k == 1 for size in sizes for k in range(size)], device=outputs.device)
    squashed = middle + half * torch.tanh(outputs / half)
    outputs = torch.where(is_log_variance, squashed, outputs)
    ends = list(accumulate(sizes))
    return tuple(outputs[:, end - size : end] for size, end in zip(sizes, ends, strict=True))


def cell_centres(count: int) -> NDArray[np.float32]:
    """Return the centres (count,) of as many equal cells from -1 to 1."""
    return (np.arange(count, dtype=np.float32) + np.float32(0.5)) * np.float32(2.0 / count) - np.float32(1.0)


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
            custom_translation_table={torch.ops.aten.softplus.default: _softplus},
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


def _softplus(x: Any, *_: Any) -> Any:
    """Return ONNX's own node for a softplus, in place of nine that torch writes."""
    from onnxscript import opset20

    return opset20.Softplus(x)


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
