"""How a replay is laid out: one page per strike, one for the answer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from analyze.replay_scene import SINCE_CONTACT, strike_path

if TYPE_CHECKING:
    from analyze.replay_views import ReplayContent
    from analyze.types import TipMotion

_GROUND = (22, 25, 30)


def layout(content: ReplayContent) -> rrb.Blueprint:
    """The pages; a good strike stands in front."""
    pages = [_answer(content)] + [_strike(motion) for motion in content.motions]
    shown = content.front()
    front = 0 if shown is None else 1 + [motion.strike_id for motion in content.motions].index(shown.strike_id)
    return rrb.Blueprint(
        rrb.Tabs(*pages, active_tab=front),
        rrb.TimePanel(timeline=SINCE_CONTACT, state="collapsed", playback_speed=0.1, loop_mode="all", play_state="paused"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_layout=False,
        auto_views=False,
    )


def _strike(motion: TipMotion) -> rrb.Horizontal:
    root = strike_path(motion.strike_id)
    eye = rrb.EyeControls3D(position=(0.13, -0.33, 0.17), look_target=(0.0, 0.0, 0.06), eye_up=(0.0, 0.0, 1.0))
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    return rrb.Horizontal(
        rrb.Vertical(
            rrb.Spatial2DView(origin=f"{root}/camera", name="Camera, looking along the pivot axis", background=_GROUND),
            rrb.Spatial3DView(origin=f"{root}/world", name="Scene", background=_GROUND, eye_controls=eye, line_grid=False),
            row_shares=[1, 1],
        ),
        rrb.Vertical(
            rrb.TimeSeriesView(origin=f"{root}/theta", name="Tipping angle θ [°]", plot_legend=legend),
            rrb.TimeSeriesView(origin=f"{root}/omega", name="Rate ω [°/s]", plot_legend=legend),
            rrb.TimeSeriesView(
                origin=f"{root}/residual", name="Residual θ measured − fitted [°]", plot_legend=rrb.PlotLegend(visible=False)
            ),
            rrb.StateTimelineView(origin=f"{root}/phases", name="Phases"),
            rrb.TextDocumentView(origin=f"{root}/text", name="Fit"),
            row_shares=[3, 2.1, 1.8, 1.1, 2.0],
        ),
        column_shares=[1, 1.05],
        name=motion.strike_id,
    )


def _answer(content: ReplayContent) -> rrb.Horizontal:
    centre = content.model.bounds.mean(axis=0)
    reach = float(content.model.extent.max())
    eye = rrb.EyeControls3D(position=tuple(centre + reach * np.array([1.3, -1.7, 0.7])), look_target=tuple(centre), eye_up=(0.0, 0.0, 1.0))
    return rrb.Horizontal(
        rrb.Spatial3DView(
            origin="/result", name="Equi-planes, centre of mass, regions", background=_GROUND, eye_controls=eye, line_grid=False
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin="/summary", name="Answer"),
            rrb.TimeSeriesView(origin="/all", name="All strikes: θ [°]"),
            rrb.TextLogView(origin="/log", name="Events"),
            row_shares=[1.3, 1.2, 1],
        ),
        column_shares=[1.2, 1],
        name="Answer",
    )
