"""Key-point auto-encoder and classifier of contacts (paper Sec. IV-A, feature learning)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from palpate.lab.paper.images import CLASSES, Images
from palpate.lab.train.fit import FitSettings, fit
from palpate.lab.train.networks import MAP, WIDTH, Encoder, cell_centres, imprint, keypoint

Array = NDArray[np.float64]

BLOB = 0.1
"""Standard deviation of the Gaussian at a key point [share of the image]."""
SPARSITY = 1e-3
"""Weight of the activation: a key point is where little of the map is active."""


class KeypointNetwork(nn.Module):
    """Image to key point and back; and the class of contact from the activation map.

    The encoder is a small ResNet-18. There is one key point, the authors' choice, so no loss of separation. The
    classifier takes the activation map as it is: it does not shape it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder(WIDTH)
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
        row, column = (
            torch.exp(-(((cell_centres(count) - points[..., axis : axis + 1]) / (2.0 * BLOB)) ** 2) / 2.0)
            for count, axis in zip(MAP, (1, 0), strict=True)
        )
        return self.decoder(row[..., :, None] * column[..., None, :])


def learn_keypoints(
    images: Images,
    held_out: Images,
    settings: FitSettings,
    seed: int,
    folder: Path,
    progress: Callable[[int, str], None] | None = None,
) -> KeypointNetwork:
    """Train the auto-encoder without labels, and its classifier on the true classes; resumes from its checkpoint."""
    torch.manual_seed(seed)
    network = KeypointNetwork()

    def losses(drawn: tuple[Images, NDArray[np.int_]]) -> dict[str, Tensor]:
        source, chosen = drawn
        difference = _tensor(source.difference[chosen])
        points, logits, activation = network(difference)
        return {
            "reconstruction": ((network.reconstructed(points) - imprint(difference)) ** 2).mean(),
            "sparsity": SPARSITY * activation.mean(),
            "class": nn.functional.cross_entropy(logits, torch.from_numpy(source.contact_class[chosen])),
        }

    def draw(rng: np.random.Generator) -> tuple[Images, NDArray[np.int_]]:
        return images, rng.integers(len(images.frame), size=128)

    checked = np.random.default_rng(0).integers(len(held_out.frame), size=512)
    fit("keypoints", network, draw, losses, lambda: losses((held_out, checked)), settings, seed, folder, progress)
    return network


def keypoints_of(network: KeypointNetwork, images: Images) -> tuple[Array, Array]:
    """Return key points (N, 2) and class probabilities (N, C) of images."""
    network.eval()
    points, classes = [], []
    with torch.no_grad():
        for begin in range(0, len(images.frame), 256):
            found, logits, _ = network(_tensor(images.difference[begin : begin + 256]))
            points.append(found[:, 0].numpy())
            classes.append(logits.softmax(dim=1).numpy())
    empty = [np.empty((0, 2))], [np.empty((0, len(CLASSES)))]
    return np.concatenate(points or empty[0]).astype(float), np.concatenate(classes or empty[1]).astype(float)


def _tensor(difference: NDArray[np.float16]) -> Tensor:
    return torch.from_numpy(difference.astype(np.float32)).permute(0, 3, 1, 2)
