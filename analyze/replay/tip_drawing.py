"""Picture of an animation: a strike's image with its lines, and beside it the curves up to that time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.patheffects import AbstractPathEffect, withStroke

from analyze.least_squares.intervals import SIGMAS_95
from analyze.replay.palette import GREEN, GREY, GROUND, INK, ORANGE, RED, SKY, Colour
from analyze.result.digits import decimals

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.typing import RcKeyType
    from numpy.typing import NDArray

    from analyze.replay.animated_strike import AnimatedStrike, FrameLines
    from analyze.types import Array, IntArray

WIDTH_PX, HEIGHT_PX = 1200, 520
"""size of a picture; even numbers, as video encoders require"""
_DPI = 100
_IMAGE_BOX = (0.012, 0.03, 0.42, 0.94)
"""left, bottom, width and height of the camera's image, as fractions of the picture"""
_ANGLE_BOX, _RESIDUAL_BOX = (0.515, 0.36, 0.46, 0.46), (0.515, 0.12, 0.46, 0.15)
_MARGIN = 0.05
"""width of image around what is drawn over it, as a fraction of the larger side"""
_STYLE: dict[RcKeyType, Any] = {
    "font.size": 11.0,
    "font.family": "DejaVu Sans",
    "axes.linewidth": 0.8,
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
}


class TipDrawing:
    """Drawing of one strike, of which each image in turn is a picture of the animation.

    Args:
        strike: strike with its images and their lines.
        speed: text of the speed at which it is shown, such as "1/5 speed".
    """

    def __init__(self, strike: AnimatedStrike, speed: str) -> None:
        self._strike = strike
        self._figure = Figure(figsize=(WIDTH_PX / _DPI, HEIGHT_PX / _DPI), dpi=_DPI, facecolor=_rgb(GROUND))
        self._canvas = FigureCanvasAgg(self._figure)
        with rc_context(_STYLE):
            self._lay_out_image()
            self._lay_out_curves()
            self._lay_out_words(speed)

    def picture(self, i: int) -> NDArray[np.uint8]:
        """RGB picture (HEIGHT_PX, WIDTH_PX, 3) of image i of the strike, with the curves up to its time."""
        strike, now_ns = self._strike, int(self._strike.time_ns[i])
        self._image.set_data(strike.images[i].image)
        self._draw_lines(strike.lines[i])
        angle, fitted = strike.angle, strike.fitted
        seen, done = angle.time_ns <= now_ns, fitted.time_ns <= now_ns
        self._measured.set_data(self._ms(angle.time_ns[seen]), np.degrees(angle.theta[seen]))
        self._fitted.set_data(self._ms(fitted.time_ns[done]), np.degrees(fitted.theta[done]))
        self._residual.set_data(self._ms(fitted.time_ns[done]), np.degrees(fitted.residual[done]))
        theta = float(np.interp(now_ns, angle.time_ns, angle.theta))
        self._now.set_data(self._ms(np.array([now_ns])), [np.degrees(theta)])
        self._reading.set_text(f"θ = {round(float(np.degrees(theta)), 1) + 0.0:.1f}°")
        balanced = bool(done.any()) and float(fitted.theta[done].max()) >= strike.fit.phi
        for each in self._at_balance:
            each.set_visible(balanced)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _ms(self, time_ns: IntArray) -> Array:
        return (time_ns - self._strike.contact_ns).astype(np.float64) * 1e-6

    # --- the camera's image

    def _lay_out_image(self) -> None:
        strike = self._strike
        axes = self._figure.add_axes(_IMAGE_BOX)
        axes.set_axis_off()
        self._image = axes.imshow(strike.images[0].image, cmap="gray", vmin=0, vmax=255)
        low, high = _shown_part(strike, _IMAGE_BOX[2] * WIDTH_PX / (_IMAGE_BOX[3] * HEIGHT_PX))
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(high[1], low[1])
        dark: list[AbstractPathEffect] = [withStroke(linewidth=3.0, foreground=(0, 0, 0, 0.45))]

        def collection(colour: Colour, width: float, style: str = "solid") -> LineCollection:
            lines = LineCollection(
                [], colors=[_rgb(colour)], linewidths=width, linestyles=style, capstyle="round"
            )
            lines.set_path_effects(dark)
            axes.add_collection(lines)
            return lines

        self._plumb = collection(INK, 1.2, "dotted")
        self._outline = collection(SKY, 1.8)
        self._tags = collection(GREEN, 1.8)
        self._pivot = collection(RED, 2.6)
        self._balance = collection(ORANGE, 2.2, "dashed")

    def _draw_lines(self, lines: FrameLines) -> None:
        self._tags.set_segments(list(lines.tags))
        self._outline.set_segments(list(lines.outline))
        self._outline.set_color(_rgb(SKY if lines.fitted else GREY))
        for collection, line in (
            (self._pivot, lines.pivot),
            (self._balance, lines.balance),
            (self._plumb, lines.plumb),
        ):
            collection.set_segments([line] if len(line) and np.all(np.isfinite(line)) else [])

    # --- curves

    def _lay_out_curves(self) -> None:
        strike = self._strike
        begin, end = self._ms(strike.time_ns[[0, -1]])
        inside = (strike.angle.time_ns >= strike.time_ns[0]) & (strike.angle.time_ns <= strike.time_ns[-1])
        top = 1.1 * max(float(strike.angle.theta[inside].max()), strike.fit.phi)
        axes = self._axes(_ANGLE_BOX, (begin, end), (-0.06 * np.degrees(top), np.degrees(top)))
        axes.tick_params(labelbottom=False)
        axes.set_ylabel("angle θ [°]", color=_rgb(GREY))
        phi = float(np.degrees(strike.fit.phi))
        axes.axhline(phi, color=_rgb(ORANGE), linewidth=1.3, linestyle=(0, (4, 2.5)))
        style = {"color": _rgb(ORANGE), "va": "bottom", "fontsize": 13, "weight": "bold"}
        axes.text(begin + 0.015 * (end - begin), phi, "φ", **style)
        point = {"linestyle": "none", "marker": "o", "markeredgewidth": 0.0}
        axes.axvline(0.0, color=_rgb(GREY), linewidth=0.9, linestyle="dotted")
        (self._measured,) = axes.plot([], [], markersize=5.0, color=_rgb(GREEN), **point)
        (self._fitted,) = axes.plot([], [], color=_rgb(SKY), linewidth=1.8)
        (self._now,) = axes.plot([], [], markersize=9.0, color=_rgb(INK), clip_on=False, zorder=5, **point)
        passage_ms = self._passage_ms()
        (mark,) = axes.plot(
            [np.nan if passage_ms is None else passage_ms],
            [phi],
            linestyle="none",
            marker="o",
            markersize=14.0,
            markerfacecolor="none",
            markeredgecolor=_rgb(ORANGE),
            markeredgewidth=2.0,
        )
        axes = self._axes(_RESIDUAL_BOX, (begin, end), _residual_limits(strike))
        axes.axhline(0.0, color=_rgb(GREY), linewidth=0.7)
        axes.set_xlabel("time since contact [ms]", color=_rgb(GREY))
        axes.set_ylabel("residual [°]", color=_rgb(GREY))
        (self._residual,) = axes.plot([], [], markersize=3.4, color=_rgb(GREEN), **point)
        self._figure.align_ylabels()
        self._at_balance: list[Artist] = [mark]

    def _passage_ms(self) -> float | None:
        """Time since contact [ms] at which the fitted angle reaches the balance angle φ; None if never."""
        fitted, phi = self._strike.fitted, self._strike.fit.phi
        above = np.flatnonzero(fitted.theta >= phi)
        if not len(above):
            return None
        pair = slice(max(int(above[0]) - 1, 0), int(above[0]) + 1)
        return float(np.interp(phi, fitted.theta[pair], self._ms(fitted.time_ns[pair])))

    def _axes(
        self, box: tuple[float, float, float, float], x: tuple[float, float], y: tuple[float, float]
    ) -> Axes:
        axes = self._figure.add_axes(box, facecolor=_rgb(GROUND))
        axes.set_xlim(*x)
        axes.set_ylim(*y)
        axes.tick_params(colors=_rgb(GREY), labelsize=10)
        axes.grid(color=_rgb(GREY), alpha=0.14, linewidth=0.8)
        for name, spine in axes.spines.items():
            spine.set_visible(name in {"left", "bottom"})
            spine.set_color(_rgb(GREY))
        return axes

    # --- words

    def _lay_out_words(self, speed: str) -> None:
        strike, fit = self._strike, self._strike.fit
        left, right = _ANGLE_BOX[0], _ANGLE_BOX[0] + _ANGLE_BOX[2]
        write = self._figure.text
        title = f"{_drawable(strike.object_name)}, strike {_drawable(strike.motion.strike_id)}"
        write(left, 0.935, title, color=_rgb(INK), fontsize=13, weight="bold", va="center")
        write(right, 0.935, speed, color=_rgb(GREY), fontsize=11, va="center", ha="right")
        for x, text, colour in (
            (0.0, "● measured", GREEN),
            (0.09, "— fitted", SKY),
            (0.152, "- - through the centre of mass", ORANGE),
        ):
            write(left + x, 0.872, text, color=_rgb(colour), fontsize=11, va="center")
        self._reading = write(
            right, 0.872, "", color=_rgb(INK), fontsize=13, va="center", ha="right", weight="bold"
        )
        half = SIGMAS_95 * float(np.degrees(np.sqrt(fit.covariance[0, 0])))
        digits = min(4, decimals(half))
        answer = write(
            right,
            0.40,
            f"balance φ = {np.degrees(fit.phi):.{digits}f} ± {half:.{digits}f}°",
            color=_rgb(ORANGE),
            fontsize=13,
            va="center",
            ha="right",
            weight="bold",
        )
        self._at_balance.append(answer)


def _shown_part(strike: AnimatedStrike, aspect: float) -> tuple[Array, Array]:
    """Corners (2,) and (2,) [raw px] of the part of the image to show: all lines, with a margin.

    Args:
        strike: strike with its lines.
        aspect: width over height of the space for it.
    """
    lines = [line for each in strike.lines for line in (*each.outline, *each.tags, each.pivot, each.balance)]
    points = np.concatenate([line for line in lines if len(line)])
    points = points[np.all(np.isfinite(points), axis=1)]
    height, width = strike.images[0].image.shape[:2]
    size = np.array([width, height], dtype=float)
    low = np.clip(points.min(axis=0), 0.0, size) if len(points) else np.zeros(2)
    high = np.clip(points.max(axis=0), 0.0, size) if len(points) else size
    wanted = (high - low) + 2 * _MARGIN * float((high - low).max())
    wanted = np.maximum(wanted, [wanted[1] * aspect, wanted[0] / aspect])
    wanted = np.minimum(wanted, size)
    middle = np.clip((low + high) / 2, wanted / 2, size - wanted / 2)
    return middle - wanted / 2 - 0.5, middle + wanted / 2 - 0.5


def _residual_limits(strike: AnimatedStrike) -> tuple[float, float]:
    """Range [deg] of the residuals' axis, symmetric, at least 0.02 degrees to either side."""
    most = 1.25 * float(np.degrees(np.abs(strike.fitted.residual).max()))
    return -max(most, 0.02), max(most, 0.02)


def _drawable(text: str, most: int = 28) -> str:
    """Text as the font can show it: at most `most` signs, a box for those that it lacks."""
    font = get_font(findfont(_STYLE["font.family"]))
    shown = "".join(each if font.get_char_index(ord(each)) else "□" for each in text)
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"


def _rgb(colour: Colour) -> tuple[float, float, float]:
    return colour[0] / 255, colour[1] / 255, colour[2] / 255
