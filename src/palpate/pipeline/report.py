"""The result of a run in eight lines, from its summary."""

import math
import re
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.pipeline.metrics import CONTENT, pose_words

FIGURE = "figure.png"
TOUCH = {
    "auto": "touch not read, as no untouched gel was seen so far",
    "none": "contact only",
    "learnt": "touch by the model of the images",
    "oracle": "touch by ground truth",
}


def reasons_of(status: Sequence[str], reason: Sequence[str]) -> dict[str, str]:
    """Return the usual reason for each status of N frames that has one, numbers left aside, as it was last given."""
    kinds: dict[str, Counter[str]] = {}
    examples: dict[tuple[str, str], str] = {}
    for word, sentence in zip(status, reason, strict=True):
        if sentence:
            kind = re.sub(r"\d+", "", sentence)
            kinds.setdefault(word, Counter())[kind] += 1
            examples[word, kind] = sentence
    return {word: examples[word, counted.most_common(1)[0][0]] for word, counted in kinds.items()}


def run_lines(name: str, summary: Mapping[str, Any], folder: Path) -> list[str]:
    """Return lines on a run: what was tracked, final pose, error, statuses with reasons, warnings, and files."""
    why = summary.get("tactile_reason")
    touch = f"{TOUCH.get(summary['tactile'], summary['tactile'])}{f' ({why})' if why else ''}"
    pose = pose_words(summary["final_pose"], summary["final_sigma"])
    lines = {
        name: f"{summary['frames']} frames, {summary['contact_frames']} in contact, {touch}",
        "final pose": f"{pose} (1 sigma), {summary['final_status']}",
    }
    if summary["scored_frames"]:
        error = f"{summary['final_translation_error_mm']:.1f} mm, {summary['final_rotation_error_deg']:.1f}°"
        rmse = f"{summary['translation_rmse_mm']:.1f} mm, {summary['rotation_rmse_deg']:.1f}°"
        lines["final error"] = f"{error}; RMSE of all frames {rmse}"
    lines |= _outline_line(summary)
    lines |= _status_lines(summary)
    warnings = summary.get("warnings", [])
    if warnings:
        more = f" (and {len(warnings) - 1} more: --all)" if len(warnings) > 1 else ""
        lines["warnings"] = f"{_short(warnings[0])}{more}"
    if summary.get("ended"):
        lines["ended"] = _short(summary["ended"])
    others = sorted({path.name for path in folder.glob("*")} - {FIGURE})
    lines["files"] = f"{folder / FIGURE}, and beside it {', '.join(others)}"
    width = max(map(len, lines)) + 2
    return [f"{title.ljust(width)}{text}" for title, text in lines.items()]


def _outline_line(summary: Mapping[str, Any]) -> dict[str, str]:
    """Return a line on an outline that was learnt, if there is one."""
    if "outline_touched_share" not in summary:
        return {}
    words = f"{summary['outline_touched_share']:.0%} touched, 1 sigma {summary['outline_sigma_mm']:.1f} mm"
    if summary.get("outline_rms_mm") is not None:
        words += f"; error where touched {summary['outline_rms_mm']:.1f} mm"
    return {"outline": words}


def _status_lines(summary: Mapping[str, Any], most: int = 2) -> dict[str, str]:
    """Return a line with the shares of good statuses, and lines with the reasons of at most some others."""
    frames = summary["frames"]
    counts = sorted(summary["statuses"].items(), key=lambda item: -item[1])
    reasons = summary.get("reasons", {})
    good = [f"{word} {count / frames:.0%}" for word, count in counts if word in CONTENT]
    doubts = [(word, count) for word, count in counts if word not in CONTENT]
    lines = {"good": ", ".join(good) or "0%"}
    for word, count in doubts[:most]:
        lines[word] = f"{count / frames:.0%}: {_short(reasons.get(word, ''))}".rstrip(": ")
    if doubts[most:]:
        lines["others"] = ", ".join(f"{word} {count / frames:.0%}" for word, count in doubts[most:])
    return lines


def _short(sentence: str) -> str:
    return textwrap.shorten(sentence, 160, placeholder=" ...")


def run_row(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of a run in a table of many; errors only where truth is known."""
    sigma_x, sigma_y, sigma_yaw = summary["final_sigma"]
    good = sum(summary["statuses"].get(word, 0) for word in CONTENT) / summary["frames"]
    row = {
        "status": summary["final_status"],
        "sigma_mm": 1e3 * math.hypot(sigma_x, sigma_y),
        "sigma_deg": math.degrees(sigma_yaw),
        "good": f"{good:.0%}",
        "warnings": len(summary["warnings"]),
    }
    if summary["scored_frames"]:
        row["error_mm"] = summary["final_translation_error_mm"]
        row["error_deg"] = summary["final_rotation_error_deg"]
        row["silently_wrong"] = summary["silently_wrong_share"]
    return row
