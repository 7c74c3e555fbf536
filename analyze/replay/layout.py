"""Layout of a replay: one page for the answer, one per strike, one for the session."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from analyze.replay.palette import GROUND
from analyze.replay.timelines import SESSION, SINCE_CONTACT, strike_path, toss_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array

    Vector = Sequence[float] | Array

ANSWER, SESSION_PAGE = "answer", "session"
VOXELS = "/result/voxels"
_DEFAULT_SIZE_M = 0.15
"""Size [m] assumed for an object whose shape is not known yet."""


@dataclass(frozen=True)
class StrikePage:
    """Page (tab of the viewer) that shows one strike; its title is the strike's id and verdict."""

    strike_id: str
    """Id of the strike."""
    verdict: str = ""
    """Verdict on the strike in words, such as "rocked back"; "" if it is not known yet."""


@dataclass(frozen=True)
class TossPage:
    """Page (tab of the viewer) that shows one toss; its title is the toss's id and verdict."""

    toss_id: str
    """Id of the toss."""
    verdict: str = ""
    """Verdict on the toss in words; "" if it is not known yet."""
    target: tuple[float, ...] = (0.0, 0.0, 0.3)
    """Middle (3,) of the flight in the world frame W [m]."""
    reach: float = 0.5
    """Size of the flight [m]."""


def timeline_of(page: str | None, *, struck: bool = True) -> str:
    """Name of the timeline that a page (tab) of the replay uses: "session" or "since_contact".

    It is "session" for the page SESSION_PAGE, and where nothing was struck; otherwise "since_contact", also
    without a page (None).
    """
    return SESSION if page == SESSION_PAGE or not struck else SINCE_CONTACT


def scene_view(
    origin: str, name: str, eye: Vector, target: Vector, hidden: Sequence[str] = ()
) -> rrb.Spatial3DView:
    """View of a 3D scene without a grid, z up.

    Args:
        origin: entity whose contents are shown.
        name: title of the view.
        eye: (3,) position of the eye in the scene [m].
        target: (3,) point that it looks at [m].
        hidden: paths of entities that are not shown until the user asks for them.
    """
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        background=GROUND,
        eye_controls=rrb.EyeControls3D(
            position=tuple(eye), look_target=tuple(target), eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=False,
        overrides={path: rrb.EntityBehavior(visible=False) for path in hidden},
    )


def without_panels(contents: rrb.Container, time: rrb.TimePanel) -> rrb.Blueprint:
    """Rerun blueprint (layout) of `contents` above the time panel `time`; other panels are hidden."""
    hidden = rrb.SelectionPanel(state="hidden"), rrb.BlueprintPanel(state="hidden")
    return rrb.Blueprint(contents, time, *hidden, auto_layout=False, auto_views=False)


def layout(
    pages: Sequence[StrikePage],
    front: str,
    bounds: Array | None = None,
    tosses: Sequence[TossPage] = (),
) -> rrb.Blueprint:
    """Layout of all pages, as rerun's blueprint: answer, strikes, tosses, session.

    Args:
        pages: pages of the strikes, in their order.
        front: page shown first: ANSWER, SESSION_PAGE or the id of a strike or toss; the answer if there is
            no such page.
        bounds: lower and upper bounds (2, 3) [m] of the object in its frame; None if not known yet.
        tosses: pages of the tosses, in their order.
    """
    names = [ANSWER, *(page.strike_id for page in pages), *(page.toss_id for page in tosses), SESSION_PAGE]
    reach = _DEFAULT_SIZE_M if bounds is None else float(np.ptp(bounds, axis=0).max())
    return without_panels(
        rrb.Tabs(
            _answer(np.zeros(3) if bounds is None else bounds.mean(axis=0), reach, len(pages)),
            *(_strike(page, reach) for page in pages),
            *(_toss(page) for page in tosses),
            _session(loose=not pages and not tosses),
            active_tab=names.index(front) if front in names else 0,
        ),
        rrb.TimePanel(
            timeline=timeline_of(front, struck=bool(pages or tosses)),
            state="collapsed",
            playback_speed=0.1,
            loop_mode="all",
            play_state="paused",
        ),
    )


def _strike(page: StrikePage, reach: float) -> rrb.Horizontal:
    root = strike_path(page.strike_id)
    eye, target = (0.75 * reach, -1.9 * reach, 1.0 * reach), (0.1 * reach, 0.0, 0.36 * reach)
    axis = rrb.TimeAxis(link="LinkToGlobal")

    def plot(path: str, name: str, legend: rrb.PlotLegend) -> rrb.TimeSeriesView:
        return rrb.TimeSeriesView(origin=f"{root}/{path}", name=name, plot_legend=legend, axis_x=axis)

    none = rrb.PlotLegend(visible=False)
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.Spatial2DView(
                origin=f"{root}/camera",
                name="Camera: tag or print, fitted pose, pivot axis",
                background=GROUND,
            ),
            scene_view(f"{root}/world", "Scene", eye, target),
            row_shares=[1.2, 1],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{root}/text", name="Verdict"),
            plot("theta", "Tipping angle θ [°]", rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)),
            plot("residual", "Residual θ, measured − fitted [°]", none),
            plot("omega", "Rate ω [°/s]", none),
            plot("alpha", "Acceleration θ'' [°/s²]; measured: smoothed", none),
            rrb.StateTimelineView(
                origin=root,
                contents=[f"{root}/phases", f"{root}/striker"],
                name="Phases of the tip; striker",
                time_view=axis,
            ),
            row_shares=[1.55, 2.9, 1.3, 1.6, 1.6, 1.35],
        ),
        column_shares=[1, 1.05],
        name=f"{page.strike_id} {page.verdict}".strip(),
    )


def _toss(page: TossPage) -> rrb.Horizontal:
    root, axis = toss_path(page.toss_id), rrb.TimeAxis(link="LinkToGlobal")
    target = np.array(page.target)
    eye = target + page.reach * np.array([0.6, -1.5, 0.5])

    def plot(path: str, name: str, *, legend: bool = True) -> rrb.TimeSeriesView:
        shown = rrb.PlotLegend(corner=rrb.Corner2D.RightTop, visible=legend)
        return rrb.TimeSeriesView(origin=f"{root}/{path}", name=name, plot_legend=shown, axis_x=axis)

    return rrb.Horizontal(
        rrb.Vertical(
            rrb.Spatial2DView(
                origin=f"{root}/camera", name="Camera: tags, fitted pose, track of c", background=GROUND
            ),
            scene_view(f"{root}/world", "Flight", eye, target),
            row_shares=[1.2, 1],
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{root}/text", name="Verdict"),
            plot("rate", "Angular velocity along the object's axes [turns/s]"),
            plot("residual", "Corners' distance from the fitted flight [px rms]"),
            plot("height", "Height of c [mm]", legend=False),
            row_shares=[1.2, 3, 2, 1.6],
        ),
        column_shares=[1, 1.05],
        name=f"{page.toss_id} {page.verdict}".strip(),
    )


def _answer(centre: Array, reach: float, strikes: int) -> rrb.Horizontal:
    name = "Where the equi-planes meet (colours: strikes, below); dots: yellow upper, violet lower region"
    eye = np.array([0.95, -1.25, 0.5])
    return rrb.Horizontal(
        rrb.Vertical(
            scene_view("/result", name, centre + reach * eye, centre, hidden=[VOXELS]),
            rrb.TimeSeriesView(
                origin="/all",
                name="All strikes: θ [°]",
                plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop),
            ),
            row_shares=[1 - (share := _legend_share(strikes)), share],
        ),
        rrb.TextDocumentView(origin="/summary", name="Answer"),
        column_shares=[1.2, 1],
        name="Answer",
    )


def _legend_share(strikes: int) -> float:
    """Share of the page's height for a plot whose legend has a line per strike, from 0.3 to 0.5."""
    return min(max(0.3, 0.1 + 0.027 * strikes), 0.5)


def _session(*, loose: bool) -> rrb.Horizontal:
    camera = rrb.Spatial2DView(origin="/session/camera", name="Camera", background=GROUND)
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.TextDocumentView(origin="/session/text", name="Camera and clocks"),
            rrb.StateTimelineView(
                origin="/session",
                contents=["/session/state", "/session/striker"],
                name="Session and striker (timeline: session)",
            ),
            rrb.TimeSeriesView(
                origin="/session/lost", name="Frames lost since the start (timeline: session)"
            ),
            rrb.TimeSeriesView(origin="/session/clock", name="Clocks [µs] (timeline: session)"),
            row_shares=[1.1, 1.1, 1, 1.4],
        ),
        rrb.Vertical(rrb.TextLogView(origin="/log", name="Events"), *[camera] * loose),
        column_shares=[1.3, 1],
        name="Session",
    )
