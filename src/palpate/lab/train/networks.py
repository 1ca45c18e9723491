"""The networks: what they take, what they give, and nothing of how they are trained.

All take differences from the untouched gel, (B, 3, 32, 128), as `palpate.touch.difference` makes them.
"""

import torch
from torch import Tensor, nn

from palpate.touch.difference import COLUMNS, ROWS
from palpate.touch.model import KINDS

MAP = (ROWS // 4, COLUMNS // 4)
"""Rows and columns of the feature map."""
WIDTH = 16
"""Channels of the encoder and the decoder. ONNX Runtime takes sixteen at a time: 24 cost as much as 32."""
_HIDDEN = 64
_BLOB = 0.1  # standard deviation of a key point's blob, as a share of the image
_LEAST, _MOST = -6.0, 1.0  # [log rad] between which a predicted standard deviation lies
_AROUND = (3, 13)  # rows and columns that tell whether a place is touched: 2.3 and 1.9 mm of a DIGIT
_FAINT = 0.2  # mean difference there, 6 grey levels, that is believed by half


class Encoder(nn.Module):
    """A small ResNet-18 (paper Sec. IV-A): three stages of two blocks on a map of 8 x 32, a quarter of an image."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, width, 7, stride=2, padding=3, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            nn.MaxPool2d(3, stride=2, padding=1),
            *(_Block(width) for _ in range(6)),
        )

    def forward(self, difference: Tensor) -> Tensor:
        """Return the feature map (B, width, 8, 32) of the imprint."""
        return self.layers(imprint(difference))


class _Block(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, padding=1, bias=False),
            nn.BatchNorm2d(width),
        )

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.layers(x))


class KeypointEncoder(nn.Module):
    """Images to one key point and its activation map (paper Sec. IV-A, after Minderer 2019), and to a class."""

    def __init__(self, width: int = WIDTH) -> None:
        super().__init__()
        self.encoder = Encoder(width)
        self.heat = nn.Conv2d(width, 1, 1)
        self.classifier = nn.Sequential(
            nn.Flatten(),
            nn.Linear(MAP[0] * MAP[1], 32),
            nn.ReLU(),
            nn.Linear(32, 32),
            nn.ReLU(),
            nn.Linear(32, len(KINDS)),
        )

    def forward(self, difference: Tensor) -> tuple[Tensor, Tensor]:
        """Return key points (B, 2), column and row in -1 to 1, and logits of the kinds (B, C)."""
        return self.parts(difference)[:2]

    def parts(self, difference: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return what `forward` does and the activation map (B, 1, 8, 32), which is positive.

        The classifier takes the map as it is: it does not shape it.
        """
        activation = nn.functional.softplus(self.heat(self.encoder(difference)))
        return keypoint(activation)[:, 0], self.classifier(activation.detach()), activation


class Decoder(nn.Module):
    """Key points' blobs (B, 1, 8, 32) back to differences (B, 3, 32, 128)."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(1, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, WIDTH, 3, padding=1),
            nn.ReLU(),
            nn.Upsample(scale_factor=2, mode="bilinear", align_corners=False),
            nn.Conv2d(WIDTH, 3, 3, padding=1),
        )

    def forward(self, blobs: Tensor) -> Tensor:
        """Return differences (B, 3, 32, 128)."""
        return self.layers(blobs)


class TouchNetwork(nn.Module):
    """Images to all that one image says: where it is touched, how the sensor is turned, and a descriptor."""

    def __init__(self, tells_place: bool = False, width: int = WIDTH) -> None:
        """Take whether the gel is flat, so that where along it it is touched is told besides."""
        super().__init__()
        self.encoder = Encoder(width)
        self.points = nn.Conv2d(width, 4, 1)
        self.reduce = nn.Conv2d(width, 8, 1)
        self.body = nn.Sequential(
            nn.Linear(8 * 2 * MAP[1] + 8, 2 * _HIDDEN), nn.ReLU(), nn.Linear(2 * _HIDDEN, _HIDDEN), nn.ReLU()
        )
        self.direction = nn.Linear(_HIDDEN + 8, 2)
        self.turn = nn.Linear(_HIDDEN + 8, 2)
        self.descriptor = nn.Linear(_HIDDEN + 8, DESCRIPTOR)
        self.place = nn.Linear(_HIDDEN + 8, 2) if tells_place else None

    def forward(self, difference: Tensor) -> tuple[Tensor, ...]:
        """Return direction (B, 2) and turn (B, 2), each mean [rad] and log variance, and descriptor (B, D).

        Of a flat gel also the place (B, 2), mean [cm] and log variance.
        """
        features = self.encoder(difference)
        points = keypoint(nn.functional.softplus(self.points(features))).flatten(1)
        coarse = nn.functional.avg_pool2d(torch.relu(self.reduce(features)), (MAP[0] // 2, 1)).flatten(1)
        body = self.body(torch.cat([coarse, points], dim=1))
        said = torch.cat([body, points], dim=1)
        told = gaussian(self.direction(said)), gaussian(self.turn(said)), self.descriptor(said)
        return told if self.place is None else (*told, gaussian(self.place(said)))


class DirectionNetwork(nn.Module):
    """Images to the direction alone: what can be learnt where nothing else is known of them."""

    def __init__(self) -> None:
        super().__init__()
        self.image = TouchNetwork()

    def forward(self, difference: Tensor) -> Tensor:
        """Return mean [rad] and log variance (B, 2)."""
        return self.image(difference)[0]


DESCRIPTOR = 16
"""Numbers that describe an image to the pair network."""


class PairNetwork(nn.Module):
    """Descriptors of two images to the sensor's turn between them, mean and log variance.

    Exchanging the images changes the sign of the mean and leaves the variance: the paper's symmetric loss, built in.
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(2 * DESCRIPTOR, _HIDDEN), nn.ReLU(), nn.Linear(_HIDDEN, _HIDDEN), nn.ReLU(), nn.Linear(_HIDDEN, 2)
        )

    def forward(self, earlier: Tensor, later: Tensor) -> Tensor:
        """Return mean [rad] and log variance (B, 2) for descriptors (B, D) each."""
        there = self.layers(torch.cat([earlier, later], dim=1))
        back = self.layers(torch.cat([later, earlier], dim=1))
        return gaussian(torch.stack([there[:, 0] - back[:, 0], 0.5 * (there[:, 1] + back[:, 1])], dim=1))


def imprint(difference: Tensor) -> Tensor:
    """Return differences (B, 3, H, W) without what is faint all around: there the light wandered or the gel gave way.

    Simulation knows too little of that, and networks that see it read much into it on real gels.
    """
    strength = difference.abs().mean(dim=1, keepdim=True)
    for rows, columns in ((_AROUND[0], 1), (1, _AROUND[1])):  # one after the other, which is the same and much faster
        strength = nn.functional.avg_pool2d(
            strength, (rows, columns), stride=1, padding=(rows // 2, columns // 2), count_include_pad=False
        )
    fourth = (strength / _FAINT) ** 4
    return difference * (fourth / (fourth + 1.0))


def keypoint(activation: Tensor) -> Tensor:
    """Return the centres (B, K, 2) of positive maps (B, K, H, W): column and row, from -1 to 1."""
    height, width = activation.shape[-2:]
    total = activation.sum(dim=(2, 3)) + 1e-6
    column = (activation.sum(dim=2) * _places(width)).sum(dim=2) / total
    row = (activation.sum(dim=3) * _places(height)).sum(dim=2) / total
    return torch.stack([column, row], dim=-1)


def blobs(points: Tensor, size: tuple[int, int] = MAP) -> Tensor:
    """Return maps (B, K, *size) with a Gaussian blob at each key point (B, K, 2)."""
    row, column = (
        torch.exp(-(((_places(count) - points[..., axis : axis + 1]) / (2.0 * _BLOB)) ** 2) / 2.0)
        for count, axis in zip(size, (1, 0), strict=True)
    )
    return row[..., :, None] * column[..., None, :]


def gaussian(said: Tensor) -> Tensor:
    """Return mean and log variance (B, 2), the standard deviation kept between what images can tell and all angles."""
    middle, half = _LEAST + _MOST, _MOST - _LEAST
    return torch.stack([said[:, 0], middle + half * torch.tanh(said[:, 1] / half)], dim=1)


def _places(count: int) -> Tensor:
    return (torch.arange(count) + 0.5) * (2.0 / count) - 1.0
