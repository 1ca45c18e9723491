"""Finds the pose of an object by touch: tactile images and sensor poses in, object pose with covariance out."""

from palpate.errors import EstimationError, FileError, PalpateError, SettingError, ShapeError
from palpate.formats import load_recording
from palpate.graph.noise import PUBLISHED, GraphNoise
from palpate.recording import Frame, Recording, read_recording, write_recording
from palpate.sensor import DIGIT, POINT, SensorProfile
from palpate.shapes import Disc, Ellipse, Polygon, Rectangle, Shape
from palpate.tracker import Estimate, Tracker, TrackerSettings
from palpate.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "DIGIT",
    "POINT",
    "PUBLISHED",
    "Disc",
    "Ellipse",
    "Estimate",
    "EstimationError",
    "FileError",
    "Frame",
    "GraphNoise",
    "PalpateError",
    "Polygon",
    "Recording",
    "Rectangle",
    "SensorProfile",
    "SettingError",
    "Shape",
    "ShapeError",
    "Tracker",
    "TrackerSettings",
    "Trajectory",
    "load_recording",
    "read_recording",
    "write_recording",
]
