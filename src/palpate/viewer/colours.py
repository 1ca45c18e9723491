"""Colours of all views: Okabe and Ito's palette, which people with any colour vision can tell apart."""

from palpate.types.estimate import Status

TRUTH, ESTIMATE, SENSOR = "#8C8C8C", "#0E86CC", "#D55E00"
CONTACT, OTHERS = "#E69F00", "#CC79A7"
STATUS: dict[Status, str] = {
    "tracking": "#009E73",
    "resting": "#A6B8C2",
    "ambiguous": "#E69F00",
    "strained": "#D55E00",
    "uncertain": "#F0E442",
    "displaced": "#CC79A7",
    "indeterminate": "#7F3FBF",
    "faulty": "#B00020",
}
