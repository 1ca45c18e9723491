"""Trained networks as ONNX files and back."""

import logging
import warnings
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import nn

from palpate.errors import EstimationError
from palpate.lab.train.learn import Keypoints, Touch
from palpate.lab.train.networks import DESCRIPTOR, DirectionNetwork
from palpate.touch.difference import COLUMNS, ROWS
from palpate.touch.model import ARRAYS, PLACE, session

_CLOSE = 1e-4  # by which outputs in ONNX Runtime may differ
_PAIRS = 3


def exported(keypoints: Keypoints, touch: Touch) -> dict[str, bytes]:
    """Return the networks of a touch model as ONNX files, checked to say what they say in torch."""
    image = torch.randn(1, 3, ROWS, COLUMNS)
    earlier, later = torch.randn(2, _PAIRS, DESCRIPTOR)
    return {
        "touch": _onnx(
            touch.image, {"difference": image}, [*ARRAYS["touch"][1], *([PLACE] if touch.image.place else [])]
        ),
        "pair": _onnx(touch.pair, {"earlier": earlier, "later": later}, ["turned"], any_number=True),
        "keypoint": _onnx(keypoints.encoder, {"difference": image}, ["keypoint", "kinds"]),
    }


def exported_direction(network: DirectionNetwork) -> dict[str, bytes]:
    """Return the network of a model of directions alone, likewise."""
    return {"touch": _onnx(network, {"difference": torch.randn(1, 3, ROWS, COLUMNS)}, ["direction"])}


def width_of(file: bytes) -> int:
    """Return how many channels the encoder in a network's ONNX file has; EstimationError if there is none."""
    first = _weights(file).get("encoder.layers.0.weight")
    if first is None or not first.dims:
        raise EstimationError("the model's network has no encoder to go on from; was it learnt from presses?")
    return int(first.dims[0])


def restore(network: nn.Module, file: bytes) -> None:
    """Set a network's weights to those of its ONNX file; EstimationError if they do not fit it."""
    from onnx import numpy_helper

    written = _weights(file)
    state = network.state_dict()
    for name, value in state.items():
        if name.endswith("num_batches_tracked"):
            continue
        if name not in written or list(written[name].dims) != list(value.shape):
            raise EstimationError(f"the model's network has no weights {name} {tuple(value.shape)}")
        value.copy_(torch.from_numpy(numpy_helper.to_array(written[name]).copy()))


def _weights(file: bytes) -> dict[str, Any]:
    import onnx

    return {each.name: each for each in onnx.load_from_string(file).graph.initializer}


def _onnx(
    network: nn.Module, inputs: Mapping[str, torch.Tensor], outputs: list[str], any_number: bool = False
) -> bytes:
    """Export a network; weights keep their names, so that `restore` finds them."""
    network = _with_biases(network.eval())
    shapes = {name: {0: torch.export.Dim("pairs", min=1)} for name in inputs} if any_number else None
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            network,
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=outputs,
            dynamic_shapes=tuple(shapes.values()) if shapes else None,
            dynamo=True,
            optimize=False,
            external_data=False,
            verbose=False,
        )
    assert program is not None
    file = _bare(program.model_proto)
    check(network, inputs, file)
    return file


def _with_biases(network: nn.Module) -> nn.Module:
    """A copy of a network of which every convolution has a bias.

    ONNX Runtime merges the batch normalisation after it then when it opens the file: a tenth less time an image. The
    weights themselves are not merged, for training may go on from them.
    """
    other = deepcopy(network)
    for part in other.modules():
        if isinstance(part, nn.Conv2d) and part.bias is None:
            part.bias = nn.Parameter(torch.zeros(part.out_channels))
    return other


def _bare(model: Any) -> bytes:
    """A model's file without what the exporter notes of every node, such as lines of source and where they lie."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        del part.metadata_props[:]
    del graph.value_info[:]
    return model.SerializeToString()


def check(network: nn.Module, inputs: Mapping[str, torch.Tensor], file: bytes) -> None:
    """Raise EstimationError if an ONNX file says something else than the network."""
    found = session(file).run(None, {name: value.numpy() for name, value in inputs.items()})
    with torch.no_grad():
        wanted = network(*inputs.values())
    wanted = wanted if isinstance(wanted, tuple) else (wanted,)
    worst = max(float(np.abs(a - b.numpy()).max()) for a, b in zip(found, wanted, strict=True))
    if not worst < _CLOSE:
        raise EstimationError(f"ONNX Runtime differs from torch by {worst:.2g}; {_CLOSE} is allowed")
