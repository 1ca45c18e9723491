"""Trained networks as ONNX files and back."""

import logging
import warnings
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import nn

from palpate.errors import EstimationError
from palpate.lab.train.networks import TouchNetwork
from palpate.touch.touch_model import COLUMNS, ROWS, session


def exported(network: TouchNetwork, close: float = 1e-4) -> bytes:
    """Return a touch network as an ONNX file, checked to give the same outputs as in torch, within `close`.

    Weights keep their names, so that `restore` finds them. Raises EstimationError where outputs differ.
    """
    network, image = _with_biases(network.eval()), torch.randn(1, 3, ROWS, COLUMNS)
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
    found = session(file).run(None, {"difference": image.numpy()})
    with torch.no_grad():
        worst = max(float(np.abs(a - b.numpy()).max()) for a, b in zip(found, network(image), strict=True))
    if not worst < close:
        raise EstimationError(f"ONNX Runtime differs from torch by {worst:.2g}; {close} is allowed")
    return file


def width_of(file: bytes) -> int:
    """Return the number of channels of the encoder in a network's ONNX file; EstimationError if there is none."""
    first = _weights(file).get("encoder.layers.0.weight")
    if first is None or not first.dims:
        raise EstimationError("the model's network has no encoder to continue from")
    return int(first.dims[0])


def restore(network: nn.Module, file: bytes) -> None:
    """Set a network's weights to those of its ONNX file; EstimationError if they do not fit it."""
    from onnx import numpy_helper

    written = _weights(file)
    for name, value in network.state_dict().items():
        if name.endswith("num_batches_tracked"):
            continue
        if name not in written or list(written[name].dims) != list(value.shape):
            raise EstimationError(f"the model's network has no weights {name} {tuple(value.shape)}")
        value.copy_(torch.from_numpy(numpy_helper.to_array(written[name]).copy()))


def _weights(file: bytes) -> dict[str, Any]:
    import onnx

    return {each.name: each for each in onnx.load_from_string(file).graph.initializer}


def _with_biases(network: TouchNetwork) -> TouchNetwork:
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
