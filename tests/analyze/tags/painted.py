"""Pages of a PDF of tags as pixels, read from the drawing commands in the file."""

import re
import zlib

import numpy as np

PX_PER_MM = 12.0


def painted(pdf: bytes):
    """Pages as pixels (PX_PER_MM) of the filled paths in the file's drawing commands, with the sizes [mm].

    Supports black rectangles and a moved origin: all that the sheets' black areas consist of. No clipping, no
    text, no lines.
    """
    boxes = [np.array(box.split(), dtype=float) for box in re.findall(rb"/MediaBox \[([^\]]*)\]", pdf)]
    drawings = []
    for number in re.findall(rb"/Contents (\d+) 0 R", pdf):
        found = re.search(rb"\n" + number + rb" 0 obj\n.*?stream\r?\n(.*?)\r?\nendstream", pdf, re.DOTALL)
        drawings.append(zlib.decompress(found[1]).decode("latin1"))
    pages = []
    for box, text in zip(boxes, drawings, strict=True):
        scale = PX_PER_MM * 25.4 / 72
        image = np.full((int(box[3] * scale), int(box[2] * scale)), 255, dtype=np.uint8)
        for outline in black_outlines(text):
            points = (np.array(outline) * [1, -1] + [0, box[3]]) * scale
            assert len(np.unique(points.round(6), axis=0)) == 4
            # A pixel is black if its centre is.
            ends = (points.min(axis=0), points.max(axis=0))
            (left, top), (right, bottom) = (np.ceil(edge - 0.5).astype(int) for edge in ends)
            image[top:bottom, left:right] = 0
        pages.append((image, box[2:] * 25.4 / 72))
    return pages


def black_outlines(text: str):
    """Outlines, in points, that a page's drawing commands fill black."""
    origin, kept, numbers, path, black, found = np.zeros(2), [], [], [], True, []
    for word in text.split():
        if re.fullmatch(r"-?[\d.]+", word):
            numbers.append(float(word))
            continue
        match word:
            case "q":
                kept.append((origin.copy(), black))
            case "Q":
                origin, black = kept.pop()
            case "cm":
                assert numbers[-6:-2] == [1, 0, 0, 1]
                origin = origin + numbers[-2:]
            case "g" | "rg":
                black = max(numbers) == 0
            case "m":
                path.append([origin + numbers[-2:]])
            case "l":
                path[-1].append(origin + numbers[-2:])
            case "f" | "n" | "S":
                found += path if word == "f" and black else []
                path = []
        numbers = []
    return found
