"""Key-point auto-encoder and classifier of contacts (paper Sec. IV-A, feature learning)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.arrays import Array
from palpate_lab.paper.images import CLASSES, Images
from palpate_lab.train.fit import FitSettings, fit
from palpate_lab.train.networks import MAP, WIDTH, Encoder, cell_centres, imprint, keypoint


class KeypointNetwork(nn.Module):
    """Image to key point and back; and the class of contact from the activation map.

    The encoder is a small ResNet-18. There is one key point, the authors' choice, so no loss of separation. The
    classifier takes the activation map as it is: it does not shape it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.heat = nn.Conv2d(WIDTH, 1, 1)
        self.classifier = nn.Sequential(
            nn.Flatten(),
            nn.Linear(MAP[0] * MAP[1], 32),
            nn.ReLU(),
            nn.Linear(32, 32),
            nn.ReLU(),
            nn.Linear(32, len(CLASSES)),
        )
        self.decoder = nn.Sequential(
            nn.Conv2d(1, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, 3, 3, padding=1),
        )

    def forward(self, difference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return key points (B, 1, 2), column and row from -1 to 1, class logits (B, C) and the map (B, 1, 8, 32)."""
        activation = nn.functional.softplus(self.heat(self.encoder(difference)))
        return keypoint(activation), self.classifier(activation.detach()), activation

    def reconstructed(self, points: Tensor) -> Tensor:
        """Return images (B, 3, 32, 128) from key points (B, 1, 2), each drawn as a Gaussian on an empty map."""
        column = _bump(MAP[1], points[..., 0:1])
        row = _bump(MAP[0], points[..., 1:2])
        return self.decoder(row[..., :, None] * column[..., None, :])


def learn_keypoints(
    images: Images,
    held_out: Images,
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> KeypointNetwork:
    """Train the auto-encoder without labels, and its classifier on the true classes; resumes from its checkpoint.

    The network with the best reconstruction of held-out images is kept: the loss of the classifier, which grows as it
    overfits, would keep one that has hardly learnt its key points.
    """
    torch.manual_seed(seed)
    network = KeypointNetwork()

    def losses(drawn: tuple[Images, NDArray[np.int_]]) -> dict[str, Tensor]:
        source, chosen = drawn
        difference = _tensor(source.difference[chosen])
        points, logits, activation = network(difference)
        return {
            "reconstruction": ((network.reconstructed(points) - imprint(difference)) ** 2).mean(),
            "sparsity": 1e-3 * activation.mean(),
            "class": nn.functional.cross_entropy(logits, torch.from_numpy(source.contact_class[chosen])),
        }

    def draw(rng: np.random.Generator) -> tuple[Images, NDArray[np.int_]]:
        return images, rng.integers(len(images.frame), size=32)

    checked = np.random.default_rng(0).integers(len(held_out.frame), size=256)

    def on_held_out() -> dict[str, Tensor]:
        return {"reconstruction": losses((held_out, checked))["reconstruction"]}

    fit("keypoints", network, draw, losses, on_held_out, settings, seed, folder, progress)
    return network


def keypoints_of(network: KeypointNetwork, images: Images) -> tuple[Array, Array]:
    """Return key points (N, 2) and class probabilities (N, C) of images.

    The object is known, as the graph has its outline, so only the place on a rectangle is left to the classifier.
    """
    network.eval()
    of_object = torch.tensor([[1, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]], dtype=torch.float32)
    points = [np.empty((0, 2))]
    classes = [np.empty((0, len(CLASSES)))]
    with torch.no_grad():
        for begin in range(0, len(images.frame), 256):
            batch = slice(begin, begin + 256)
            found, logits, _ = network(_tensor(images.difference[batch]))
            possible = of_object[torch.from_numpy(images.contact_class[batch])]
            points.append(found[:, 0].numpy().astype(float))
            classes.append((logits + possible.log()).softmax(dim=1).numpy().astype(float))
    return np.concatenate(points), np.concatenate(classes)


def _bump(count: int, centre: Tensor) -> Tensor:
    """Return a Gaussian (B, 1, count) over the cells of a map's side, about centres (B, 1, 1) from -1 to 1."""
    blob = 0.1  # [share of the image] standard deviation
    return torch.exp(-(((torch.from_numpy(cell_centres(count)) - centre) / (2.0 * blob)) ** 2) / 2.0)


def _tensor(difference: NDArray[np.float16]) -> Tensor:
    return torch.from_numpy(difference.astype(np.float32)).permute(0, 3, 1, 2)
