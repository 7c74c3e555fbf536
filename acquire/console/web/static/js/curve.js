/** Plot of one strike: measured angle, fitted curve, balance angle, and the window of the fit. */

import { svg } from "./dom.js";
import { axes, extent, points } from "./plot.js";
import { fixed, isNumber } from "./format.js";

const AREA = [62, 34, 700, 346];
const MOST_DOTS = 400;

function thinned(values) {
  const step = Math.max(1, Math.ceil(values.length / MOST_DOTS));
  return values.filter((_, i) => i % step === 0);
}

/** Draw the curve of a strike into an SVG of 720 x 400; `curve` is null while there is none. */
export function drawCurve(plot, curve) {
  if (!curve || curve.time_s.length === 0) {
    plot.replaceChildren(svg("text", { x: 360, y: 200, "text-anchor": "middle", class: "none" }, "No curve"));
    return;
  }
  const phi = isNumber(curve.phi_deg) ? [curve.phi_deg] : [];
  const [low, high] = extent(curve.theta_deg, curve.fit_deg, phi);
  const margin = Math.max(1, 0.06 * (high - low));
  const time = extent(curve.time_s, curve.fit_time_s);
  const { group, x, y } = axes(
    AREA,
    { range: time, title: "time since contact [s]" },
    { range: [Math.min(0, low - margin), high + margin], title: "angle θ [deg]" },
  );
  const [left, top, right, bottom] = AREA;
  const parts = [];
  if (curve.window_s?.length === 2) {
    const [from, to] = curve.window_s.map((value) => Math.min(right, Math.max(left, x(value))));
    parts.push(
      svg("rect", { class: "window", x: from, y: top, width: Math.max(0, to - from), height: bottom - top }),
    );
  }
  parts.push(group);
  const [xs, ys] = [thinned(curve.time_s), thinned(curve.theta_deg)];
  parts.push(
    svg(
      "g",
      { class: "measured" },
      ...xs.map((value, i) => svg("circle", { cx: x(value).toFixed(1), cy: y(ys[i]).toFixed(1), r: 2.6 })),
    ),
    svg("polyline", { class: "fit", points: points(curve.fit_time_s, curve.fit_deg, x, y) }),
  );
  if (phi.length > 0) {
    const at = y(curve.phi_deg);
    parts.push(svg("line", { class: "phi", x1: left, x2: right, y1: at, y2: at }));
    // Beside the curve's start, where the angle is still far below the balance angle.
    const above = at - top > 24 ? -8 : 18;
    parts.push(
      svg("text", { class: "phi-label", x: left + 10, y: at + above }, `φ = ${fixed(curve.phi_deg, 2)}°`),
    );
  }
  plot.replaceChildren(...parts);
}
