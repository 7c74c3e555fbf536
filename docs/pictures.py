"""Makes the documentation's pictures of report, replay and tip: `python docs/pictures.py FILE.mcap`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

IMAGES = Path(__file__).resolve().parent / "images"
PAGE_SIZE = (1080, 1745)
"""width and greatest height of the report's picture [px]: answer, verdict and struck edges"""
TITLE_BAR_PX = 38
LEAST_GAP_PX = 12


def screenshot(page: Path, size: tuple[int, int], picture: Path) -> None:
    """Write an image of an HTML page as a browser window of `size` (width, height) [px] shows it."""
    browser = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    options = [f"--window-size={size[0]},{size[1]}", f"--screenshot={picture}"]
    subprocess.run([*browser, *options, page.as_uri()], check=True, capture_output=True)


def end_at_a_gap(picture: Path) -> None:
    """Crop an image file below its last blank stripe, so that no line of text at the end is cut in two."""
    image = cv2.imread(str(picture))
    blank = np.all(image == image[:, :1], axis=(1, 2))
    gaps = np.convolve(blank, np.ones(LEAST_GAP_PX), "valid") == LEAST_GAP_PX
    cv2.imwrite(
        str(picture), image[: np.flatnonzero(gaps)[-1] + LEAST_GAP_PX], [cv2.IMWRITE_PNG_COMPRESSION, 9]
    )


def good_strike(recording: Path) -> str:
    """Id of the first good strike of a recording."""
    from analyze import load

    return next(strike.id for strike in load(recording).strikes if strike.verdict == "good")


def main() -> int:
    """Write the pictures of report, replay and tip into docs/images; return 2 on wrong usage, else 0."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python docs/pictures.py FILE.mcap\n")
        return 2
    recording = Path(sys.argv[1])
    analyze = Path(sys.executable).with_name("analyze")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        subprocess.run([analyze, "report", recording, "-o", page], check=True)
        screenshot(page, PAGE_SIZE, IMAGES / "report.png")
        end_at_a_gap(IMAGES / "report.png")
    for name, shown in (("replay", good_strike(recording)), ("replay-answer", "answer")):
        picture = IMAGES / f"{name}.png"
        subprocess.run([analyze, "replay", recording, "--screenshot", picture, "--page", shown], check=True)
        cv2.imwrite(str(picture), cv2.imread(str(picture))[TITLE_BAR_PX:], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    subprocess.run([analyze, "replay", recording, "--animation", IMAGES / "tip.webp"], check=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
