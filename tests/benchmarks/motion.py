"""phi and k of every estimator against the Cramer-Rao bound, and verdicts: `make bench-motion`.

It takes five minutes. All strikes are simulated in the plane with dry friction, rounded edges and a striker's
push (tests/analyze/motion/sliding.py), which shares no code with the estimators. The bound is that of the
pendulum with white noise on theta, over the same frames. Interval columns are for 95 % intervals; "width" is
their median half width over twice the rms error (ideally 1).
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.errors import EstimationError
from analyze.least_squares.intervals import SIGMAS_95
from analyze.motion.balance_fit import EdgeErrors, moment_balance
from analyze.motion.edge_motion import edge_motion
from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.pendulum_motion import trajectory
from analyze.motion.sign_change import sign_change
from analyze.types import MotionFit
from schemas.strike_result import Verdict
from tests.analyze.motion.drawn_strikes import EXPECTED, KINDS, Strike, draw, draw_free
from tests.benchmarks.fit_error import MAX_BOUND, NOISES, Error

USED = (Verdict.GOOD, Verdict.ROCKED_BACK)


def bound(strike: Strike, fit: MotionFit) -> tuple[float, float]:
    """Cramer-Rao bound (1 sigma) of phi [rad] and k [relative] of the pendulum, over the fit's frames."""
    body, angle = strike.body, strike.motion.angle
    start, stop = fit.window
    time = (angle.time_ns[start:stop] - angle.time_ns[start]) * 1e-9
    theta = strike.course.theta[start:stop]
    omega = float(np.polyfit(time[:3], theta[:3], 2)[1]) if len(time) > 3 else 0.0
    _, _, jacobian = trajectory(np.asarray(time, dtype=float), body.phi, body.k, float(theta[0]), omega)
    rows = jacobian[:, :4] * np.array([0.1, 20.0, 0.02, 0.2]) / strike.noise
    variance = np.diag(np.linalg.pinv(rows.T @ rows, rcond=1e-14))
    return float(np.sqrt(variance[0])) * 0.1, float(np.sqrt(variance[1])) * 20.0 / body.k


def error(strike: Strike, fit: MotionFit) -> Error:
    limits = bound(strike, fit)
    k = fit.k or math.nan
    # The zero of theta is the mean of the resting frames; it adds to the stated sd and to the error alike.
    rest = strike.motion.angle.zero_sd
    return Error(
        fit.phi - strike.body.phi,
        k / strike.body.k - 1,
        math.sqrt(fit.covariance[0, 0]),
        math.sqrt(max(fit.covariance[1, 1], 0.0)) / strike.body.k,
        math.hypot(limits[0], rest),
        limits[1],
    )


def estimators(strike: Strike, chosen: MotionFit) -> dict[str, MotionFit]:
    """Fits of every estimator over the frames of the chosen one."""
    motion, window = strike.motion, chosen.window
    found = {"as chosen": chosen}
    for name, fit in (
        ("pivot_fit", lambda: pivot_fit(motion.angle, window)),
        ("moment_balance", lambda: _balance(strike, window)),
        ("sign_change (paper)", lambda: sign_change(motion.angle, (max(window[0] - 2, 0), window[1]))),
    ):
        try:
            found[name] = fit()
        except EstimationError:
            continue
    return found


def _balance(strike: Strike, window: tuple[int, int]) -> MotionFit:
    edge = edge_motion(strike.motion, window)
    errors = EdgeErrors(edge.offset_covariance, edge.by_radius)
    return moment_balance(edge.motion, window, strike.body.rho, errors=errors)


def accuracy(count: int, seed: int, slides: bool, console: Console) -> None:
    errors: dict[tuple[str, tuple[float, float]], list[Error]] = defaultdict(list)
    unused, vague, rng = Counter[str](), 0, np.random.default_rng([seed, int(slides)])
    for _ in track(
        range(count),
        console=Console(stderr=True),
        transient=True,
        description="edge slides" if slides else "edge holds",
    ):
        strike = draw_free(rng, slides)
        found = strike.analysed()
        if found.fit is None or found.verdict not in USED:
            unused[found.verdict.value] += 1
            continue
        if bound(strike, found.fit)[0] > MAX_BOUND:
            vague += 1
            continue
        noise = next(pair for pair in NOISES if math.degrees(strike.noise) <= pair[1] + 1e-9)
        for name, fit in estimators(strike, found.fit).items():
            errors[name, noise].append(error(strike, fit))
    table = Table(
        title=f"{count} strikes whose edge {'slides by 0.2 to 6 mm' if slides else 'holds'} "
        f"(unused {dict(unused)}, bound too large {vague})"
    )
    for heading in (
        "noise",
        "estimator",
        "strikes",
        "phi: median |error|",
        "rms / bound",
        "in 95 %",
        "width",
        "k: median |error|",
        "rms / bound",
        "in 95 %",
    ):
        table.add_column(heading, justify="left" if heading in ("noise", "estimator") else "right")
    for noise in NOISES:
        for name in ("as chosen", "pivot_fit", "moment_balance", "sign_change (paper)"):
            some = errors.get((name, noise), [])
            if some:
                table.add_row(
                    f"{noise[0]:g}-{noise[1]:g}°" if name == "as chosen" else "",
                    name,
                    str(len(some)),
                    *_cells(some),
                )
    console.print(table)


def _cells(some: list[Error]) -> list[str]:
    phi, sd = np.array([e.phi for e in some]), np.array([e.sd_phi for e in some])
    ratio = phi / np.array([e.bound_phi for e in some])
    k = np.array([e.k for e in some])
    cells = [
        f"{math.degrees(float(np.median(np.abs(phi)))):.3f}°",
        f"{_rms(ratio):.2f}",
        f"{100 * np.mean(np.abs(phi) < SIGMAS_95 * sd):.0f} %",
        f"{float(np.median(SIGMAS_95 * sd / np.array([e.bound_phi for e in some]))) / (2 * _rms(ratio)):.2f}",
    ]
    if np.any(np.isnan(k)):
        return [*cells, "", "", ""]
    inside = np.abs(k) < SIGMAS_95 * np.array([e.sd_k for e in some])
    return [
        *cells,
        f"{100 * np.median(np.abs(k)):.2f} %",
        f"{_rms(k / np.array([e.bound_k for e in some])):.2f}",
        f"{100 * np.mean(inside):.0f} %",
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def verdicts(count: int, seed: int, console: Console) -> None:
    """Print the confusion table of the verdicts."""
    words = list(
        dict.fromkeys(verdict for kind in KINDS for verdict in sorted(EXPECTED[kind], key=lambda v: v.value))
    )
    table = Table(title=f"{count * len(KINDS)} strikes: true kind (rows), verdict (columns)")
    for heading in ("", *(word.value for word in words)):
        table.add_column(heading, justify="right")
    wrong_good, accepted = 0, 0
    for index, kind in enumerate(KINDS):
        called: Counter[Verdict] = Counter()
        rng = np.random.default_rng([seed, 100 + index])
        for _ in track(range(count), console=Console(stderr=True), transient=True, description=kind):
            called[draw(kind, rng).analysed().verdict] += 1
        accepted += called[Verdict.GOOD] if kind == "good" else 0
        wrong_good += called[Verdict.GOOD] if kind != "good" else 0
        table.add_row(kind, *(str(called[word]) if called[word] else "" for word in words))
    console.print(table)
    console.print(
        f"failed strikes judged good: {wrong_good}; good strikes accepted: {100 * accepted / count:.0f} %"
    )


@click.command()
@click.option("--strikes", default=300, show_default=True, help="Strikes of each sort for the accuracy.")
@click.option("--each", default=40, show_default=True, help="Strikes of each kind for the verdicts.")
@click.option("--seed", default=1, show_default=True)
def main(strikes: int, each: int, seed: int) -> None:
    """Simulate and analyse strikes, and print the errors of phi and k and the verdicts."""
    console = Console(width=170)
    for slides in (False, True):
        accuracy(strikes, seed, slides, console)
    verdicts(each, seed, console)


if __name__ == "__main__":
    main()
