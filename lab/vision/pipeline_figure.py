"""The picture of docs/vision.md: stages of the eyes, what each hands on, and where the time goes."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, NamedTuple


class Box(NamedTuple):
    """A stage in the picture: place, words, and the stages of `lab.vision.stages` whose time it takes."""

    x: float
    y: float
    title: str
    text: str
    stages: tuple[str, ...] = ()


WIDTH: Final = 2.55
HEIGHT: Final = 1.25
BOXES: Final = {
    "camera": Box(0, 2, "1 camera", "grey image, middle of\nits exposure [s]"),
    "health": Box(0, 0, "2 health", "dark, blown, blurred,\nfrozen, wrong size", ("health",)),
    "predict": Box(3.4, 2, "3 prediction", "attitude change and\nconstant velocity", ("prediction",)),
    "start": Box(3.4, 0, "4 start", "target found again\nas a whole, or decoded", ("carry", "search")),
    "fit": Box(6.8, 2, "5 fit", "edges; grey values of\nsmall or steep tags", ("edge fit", "grey-value fit")),
    "checks": Box(6.8, 0, "6 checks", "fit, cells, attitude,\nhidden edges", ("cells", "evidence")),
    "branches": Box(10.2, 0, "7 hypotheses", "course, rival readings,\nmirror image", ("branches",)),
    "publish": Box(10.2, 2, "8 publish", "pose, covariance, or a\nrefusal with its reason"),
}
ARROWS: Final = (
    ("camera", "health", ""),
    ("camera", "predict", "image"),
    ("predict", "fit", "start"),
    ("predict", "start", "missed"),
    ("start", "fit", "start"),
    ("fit", "checks", "pose, residuals"),
    ("checks", "branches", "pose"),
    ("branches", "publish", ""),
)


def draw(times: dict[str, Any], path: Path) -> None:
    """Draw the stages with their shares of the time.

    Args:
        times: what `lab.vision.stages` measured.
        path: of the picture.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    figure, axes = plt.subplots(figsize=(11.0, 3.2), dpi=100)
    axes.set(xlim=(-0.2, 13.0), ylim=(-0.8, 3.4))
    axes.axis("off")
    for start, end, words in ARROWS:
        _arrow(axes, BOXES[start], BOXES[end], words)
    for box in BOXES.values():
        axes.add_patch(
            Rectangle((box.x, box.y), WIDTH, HEIGHT, facecolor="#eef3fa", edgecolor="#35507a", linewidth=1.2)
        )
        middle = box.x + WIDTH / 2
        axes.text(middle, box.y + HEIGHT - 0.28, box.title, ha="center", va="center", weight="bold", fontsize=10)
        axes.text(middle, box.y + 0.42, box.text, ha="center", va="center", fontsize=8.5)
        if box.stages:
            shares = (_share(times[words], box.stages) for words in ("with_attitude", "without_attitude"))
            label = " / ".join(f"{share:.0f} %" for share in shares)
            axes.text(box.x + WIDTH - 0.06, box.y - 0.05, label, ha="right", va="top", fontsize=8, color="#a03020")
    axes.text(0.0, -0.6, "red: share of the time of an image, with / without attitude", fontsize=8, color="#a03020")
    figure.tight_layout(pad=0.4)
    figure.savefig(path)
    plt.close(figure)


def _share(times: dict[str, float], stages: tuple[str, ...]) -> float:
    return 100.0 * sum(times[stage] for stage in stages) / times["whole"]


def _arrow(axes: Any, start: Box, end: Box, words: str) -> None:
    """From the nearer edges of two boxes, with what is handed on beside it."""
    beside = end.x != start.x
    if beside:
        a = (start.x + WIDTH, start.y + HEIGHT / 2)
        b = (end.x, end.y + HEIGHT / 2)
    else:
        up = end.y > start.y
        a = (start.x + WIDTH / 2, start.y + (HEIGHT if up else 0.0))
        b = (end.x + WIDTH / 2, end.y + (0.0 if up else HEIGHT))
    axes.annotate("", xy=b, xytext=a, arrowprops={"arrowstyle": "-|>", "color": "#35507a"})
    place = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
    if beside:
        axes.text(place[0], place[1] + 0.08, words, ha="center", va="bottom", fontsize=7.5)
    else:
        axes.text(place[0] + 0.08, place[1], words, ha="left", va="center", fontsize=7.5)
