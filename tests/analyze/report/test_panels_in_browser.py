"""Panels of comparison and archive pages in Debian's Chromium: no label covers another, at two widths."""

from __future__ import annotations

import pytest

from analyze.report.archive_plots import outcomes_figure, scatter_figure
from analyze.report.comparison_plots import angles_figures, forest_figure
from analyze.report.page import figure_element, page_environment
from schemas.comparison import QuantityPrecision, SessionValue
from schemas.quantity import Quantity
from tests.analyze.watched_page import DESKTOP, PHONE, watched

SESSIONS = ["session 1", "session 2", "session 10"]


def precision(name: str, kind: str, mean: float, sd: float) -> QuantityPrecision:
    sessions = [
        SessionValue(
            session=i + 1,
            value=mean + (i - 1) * sd,
            interval95=[mean + (i - 3) * sd, mean + (i + 1) * sd],
            results=[mean + (i - 1) * sd, mean + i * sd],
        )
        for i in range(len(SESSIONS))
    ]
    joint = Quantity(value=mean, unit="m", sd=sd / 2, interval95=[mean - sd, mean + sd])
    return QuantityPrecision(
        name=name, kind=kind, unit="m", grouped_by="session", sessions=sessions, together=joint, mean=mean,
        s_r=sd, freedom_r=2, s_L=0.0, s_R=sd, freedom_R=2, mandel_h=None,
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    near, wide = precision("x", "centre_of_mass", -0.0123456, 3e-8), precision("z", "moment", 12.3456, 0.004)
    phi = precision("φ p4e0-first-heading", "phi", 0.6, 2e-4)
    figures = [
        forest_figure(near, SESSIONS, 1e3, "mm"),
        forest_figure(wide, SESSIONS, 1.0, "kg m²", 2),
        *angles_figures([phi, phi], SESSIONS, 1),
        scatter_figure({"centre of mass x": [0.8, 1.3], "Ixx": [40.0]}),
        outcomes_figure(12, [("too few strikes", 3), ("damaged", 0)]),
    ]
    drawn = "".join(f"<figure>{figure_element(figure)}</figure>" for figure in figures)
    style = page_environment().get_template("style.css").render()
    path = tmp_path_factory.mktemp("panels") / "panels.html"
    path.write_text(f"<style>{style}</style><main><div class='panels'>{drawn}</div></main>", encoding="utf-8")
    return path


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_no_label_of_a_panel_covers_another(chromium, page, size):
    with watched(chromium, size) as shown:
        shown.page.goto(page.as_uri())
        assert shown.plots() == 6
        assert shown.faults() == []
