"""Key-point auto-encoder and classifier of contacts (paper Sec. IV-A, feature learning)."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.arrays import Array
from palpate.errors import SettingError
from palpate.touch.touch_model import shipped_model
from palpate_lab.paper.images import CLASSES, Images, draw_pairs, turn_between
from palpate_lab.train.fit import FitSettings, fit
from palpate_lab.train.networks import MAP, WIDTH, Encoder, cell_centres, imprint, keypoint, restore

POINTS = 4
"""Key points, as the touch model has them; the authors have one."""


class KeypointNetwork(nn.Module):
    """Image to key point and back; and the class of contact from the activation map.

    The encoder is a small ResNet-18. The classifier takes the activation maps as they are: it does not shape them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.points = nn.Conv2d(WIDTH, POINTS, 1)
        self.classifier = nn.Sequential(
            nn.Flatten(),
            nn.Linear(POINTS * MAP[0] * MAP[1], 32),
            nn.ReLU(),
            nn.Linear(32, 32),
            nn.ReLU(),
            nn.Linear(32, len(CLASSES)),
        )
        self.decoder = nn.Sequential(
            nn.Conv2d(POINTS, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, 3, 3, padding=1),
        )

    def forward(self, difference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return key points (B, K, 2), column and row from -1 to 1, class logits (B, C), the maps (B, K, 8, 32)."""
        activation = nn.functional.softplus(self.points(self.encoder(difference)))
        return keypoint(activation), self.classifier(activation.detach()), activation

    def reconstructed(self, points: Tensor) -> Tensor:
        """Return images (B, 3, 32, 128) from key points (B, K, 2), each drawn as a Gaussian on an empty map."""
        column = _bump(MAP[1], points[..., 0:1])
        row = _bump(MAP[0], points[..., 1:2])
        return self.decoder(row[..., :, None] * column[..., None, :])


def started() -> KeypointNetwork:
    """Return a network whose encoder and key points start from palpate's touch model of a DIGIT, the same layers.

    From nothing, a few hundred steps leave features that tell little more than a constant.
    """
    network = KeypointNetwork()
    file = shipped_model("DIGIT").folder / "touch.onnx"
    restore(nn.ModuleDict({"encoder": network.encoder, "points": network.points}), file.read_bytes())
    return network


def load_features(named: str) -> nn.Module:
    """Return the network of a class in a Python file, "FILE:Class", with `forward` and `reconstructed` as above.

    Raises SettingError if there is none, or if what it gives does not have these shapes.
    """
    file, _, name = named.rpartition(":")
    spec = importlib.util.spec_from_file_location("own_features", file) if Path(file).is_file() else None
    if spec is None or spec.loader is None:
        raise SettingError(f"features is {named!r}; allowed is FILE.py:Class with a file that exists")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    network_class = getattr(module, name, None)
    if not (isinstance(network_class, type) and issubclass(network_class, nn.Module)):
        raise SettingError(f"{file}: has no class {name!r} of torch.nn.Module")
    network = network_class()
    wanted = "points (B, K, 2), logits (B, 4) and activation; reconstructed gives images (B, 3, 32, 128)"
    try:
        points, logits, _ = network(torch.zeros(2, 3, 32, 128))
        shapes = (points.ndim, *points.shape[::2], *logits.shape, *_reconstructed(network, points).shape)
    except Exception as error:  # anything that a stranger's network can raise
        raise SettingError(f"{named}: failed on images (2, 3, 32, 128), {error}; wanted is {wanted}") from error
    if shapes != (3, 2, 2, 2, len(CLASSES), 2, 3, 32, 128):
        raise SettingError(f"{named}: gives other shapes than {wanted}")
    return network


def _reconstructed(network: nn.Module, points: Tensor) -> Tensor:
    """Return the images of a network's own decoder."""
    decode: Any = network.reconstructed
    return decode(points)


def learn_keypoints(
    network: nn.Module,
    images: Images,
    held_out: Images,
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> None:
    """Train the auto-encoder without labels, and its classifier on the true classes; resumes from its checkpoint.

    The network with the best reconstruction of held-out images is kept: the loss of the classifier, which grows as it
    overfits, would keep one that has hardly learnt its key points.
    """

    def losses(drawn: tuple[Images, NDArray[np.int_]]) -> dict[str, Tensor]:
        source, chosen = drawn
        difference = _tensor(source.difference[chosen])
        points, logits, _ = network(difference)
        return {
            "reconstruction": ((_reconstructed(network, points) - imprint(difference)) ** 2).mean(),
            "class": nn.functional.cross_entropy(logits, torch.from_numpy(source.contact_class[chosen])),
        }

    def draw(rng: np.random.Generator) -> tuple[Images, NDArray[np.int_]]:
        return images, rng.integers(len(images.frame), size=32)

    checked = np.random.default_rng(0).integers(len(held_out.frame), size=256)

    def on_held_out() -> dict[str, Tensor]:
        return {"reconstruction": losses((held_out, checked))["reconstruction"]}

    fit("keypoints", network, draw, losses, on_held_out, settings, seed, folder, progress)


def learn_turns(
    network: nn.Module,
    images: Images,
    held_out: Images,
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> None:
    """Train the encoder on by the loss of the transform prediction, Eq. 4, with a linear layer for each class.

    The layer is left behind: `transform_network` fits its own. Resumes from its checkpoint.
    """
    torch.manual_seed(seed)
    with torch.no_grad():
        features = network(torch.zeros(1, 3, 32, 128))[0].flatten(1).shape[1]
    layer = nn.Parameter(torch.zeros(len(CLASSES), features))
    both = nn.ModuleDict({"network": network})
    both.register_parameter("layer", layer)

    def losses(drawn: tuple[Images, tuple[NDArray[np.int_], NDArray[np.int_]]]) -> dict[str, Tensor]:
        source, (earlier, later) = drawn
        pair = np.concatenate([earlier, later])
        points = network(_tensor(source.difference[pair]))[0].flatten(1)
        moved = points[len(earlier) :] - points[: len(earlier)]
        of_class = torch.from_numpy(np.eye(len(CLASSES), dtype=np.float32)[source.contact_class])
        weight = 0.5 * (of_class[earlier] + of_class[later]) @ layer
        sine = torch.from_numpy(np.sin(turn_between(source, earlier, later)).astype(np.float32))
        return {"turn": 0.5 * (((weight * moved).sum(dim=1) - sine) ** 2).mean()}

    def draw(rng: np.random.Generator) -> tuple[Images, tuple[NDArray[np.int_], NDArray[np.int_]]]:
        return images, draw_pairs(images, 32, rng)

    checked = draw_pairs(held_out, 256, np.random.default_rng(0))
    fit("turns", both, draw, losses, lambda: losses((held_out, checked)), settings, seed, folder, progress)


def keypoints_of(network: nn.Module, images: Images) -> tuple[Array, Array]:
    """Return key points (N, 2 K) and class probabilities (N, C) of images.

    The object is known, as the graph has its outline, so only the place on a rectangle is left to the classifier.
    """
    network.eval()
    of_object = torch.tensor([[1, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]], dtype=torch.float32)
    points: list[Array] = []
    classes: list[Array] = []
    with torch.no_grad():
        for begin in range(0, max(len(images.frame), 1), 256):  # once for no images at all
            batch = slice(begin, begin + 256)
            found, logits, _ = network(_tensor(images.difference[batch]))
            possible = of_object[torch.from_numpy(images.contact_class[batch])]
            points.append(found.flatten(1).numpy().astype(float))
            classes.append((logits + possible.log()).softmax(dim=1).numpy().astype(float))
    return np.concatenate(points), np.concatenate(classes)


def _bump(count: int, centre: Tensor) -> Tensor:
    """Return a Gaussian (B, K, count) over the cells of a map's side, about centres (B, K, 1) from -1 to 1."""
    blob = 0.1  # [share of the image] standard deviation
    return torch.exp(-(((torch.from_numpy(cell_centres(count)) - centre) / (2.0 * blob)) ** 2) / 2.0)


def _tensor(difference: NDArray[np.float16]) -> Tensor:
    return torch.from_numpy(difference.astype(np.float32)).permute(0, 3, 1, 2)
