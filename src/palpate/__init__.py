"""Finds the pose of an object by touch: tactile images and sensor poses in, object pose with covariance out."""

from palpate.errors import EstimationError, FileError, PalpateError, SettingError, ShapeError
from palpate.formats import load_recording
from palpate.formats.palpate_h5 import read_recording, write_recording
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle, Shape
from palpate.graph.noise import PUBLISHED, GraphNoise
from palpate.recording.frame import Frame
from palpate.recording.recording import Recording
from palpate.recording.sensor import DIGIT, POINT, SensorProfile
from palpate.recording.trajectory import Trajectory
from palpate.touch.background import Background, load_background
from palpate.touch.model import TouchModel
from palpate.tracker import Estimate, Tracker, TrackerSettings

__version__ = "0.1.0"

__all__ = [
    "DIGIT",
    "POINT",
    "PUBLISHED",
    "Background",
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
    "TouchModel",
    "Tracker",
    "TrackerSettings",
    "Trajectory",
    "load_background",
    "load_recording",
    "read_recording",
    "write_recording",
]
