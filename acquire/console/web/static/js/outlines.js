/** Outlines of the object seen along x, y and z, with the 95 % ellipses of its centre of mass. */

import { make, svg } from "./dom.js";
import { AXIS_NAMES, ellipse95, VIEW_AXES, widened } from "./ellipse.js";
import { fixed } from "./format.js";
import { ticks } from "./plot.js";

const SIZE = 260;
const MARGIN = 26;
const GAP = 10;
/** Half axis [px] below which a ring marks the ellipse. */
const SMALL_PX = 5;
/** Earlier estimates that are drawn. */
const EARLIER = 4;

let clips = 0;

function drawEllipse(estimate, plane, at, unit, name) {
  const { long_m, short_m, angle } = ellipse95(widened(estimate.com_covariance_m2, estimate.com_open), plane);
  const [cx, cy] = at([estimate.com_m[plane[0]], estimate.com_m[plane[1]]]);
  return svg("ellipse", {
    class: name,
    cx,
    cy,
    rx: Math.max(long_m * unit, 0.8),
    ry: Math.max(short_m * unit, 0.8),
    transform: `rotate(${(-angle * 180) / Math.PI} ${cx} ${cy})`,
  });
}

/** One view; `history` holds estimates from old to new, all with a centre of mass. */
function view(axis, hull, bounds, history, unit_px) {
  const plane = VIEW_AXES[axis];
  const [low, high] = bounds;
  const spans = plane.map((each) => high[each] - low[each]);
  const unit = unit_px;
  const [width, height] = spans.map((span) => span * unit);
  const [left, top] = [(SIZE - width) / 2 + GAP, (SIZE - height) / 2];
  const at = ([h, v]) => [left + (h - low[plane[0]]) * unit, top + (high[plane[1]] - v) * unit];
  const plot = svg("svg", { viewBox: `-28 -6 ${SIZE + 46} ${SIZE + 42}`, role: "img" });
  const names = plane.map((each) => AXIS_NAMES[each]);
  const corners = hull?.length > 2 ? hull : [[0, 0], [1, 0], [1, 1], [0, 1]].map(([a, b]) => [low[plane[0]] + a * spans[0], low[plane[1]] + b * spans[1]]);
  plot.append(svg("polygon", { class: "body", points: corners.map((each) => at(each).map((value) => value.toFixed(1)).join(",")).join(" ") }));
  clips += 1;
  const clip = `clip-${clips}`;
  const box = { x: left - 12, y: top - 12, width: width + 24, height: height + 24 };
  plot.append(svg("clipPath", { id: clip }, svg("rect", box)));
  const inside = svg("g", { "clip-path": `url(#${clip})` });
  const shown = history.slice(-EARLIER - 1);
  shown.forEach((estimate, i) => {
    const age = shown.length - 1 - i;
    inside.append(drawEllipse(estimate, plane, at, unit, age === 0 ? "now" : `before age-${age}`));
  });
  plot.append(inside);
  const newest = shown.at(-1);
  if (newest) {
    const [cx, cy] = at(plane.map((each) => newest.com_m[each]));
    const { long_m } = ellipse95(newest.com_covariance_m2, plane);
    plot.append(svg("path", { class: "centre", d: `M${cx - 6},${cy}h12M${cx},${cy - 6}v12` }));
    if (long_m * unit < SMALL_PX) plot.append(svg("circle", { class: "ring", cx, cy, r: 11 }));
  }
  const y = top + height + 10;
  plot.append(svg("path", { class: "axis", d: `M${left},${y}h${width}M${left - 10},${top}v${height}` }));
  for (const value of ticks(low[plane[0]], high[plane[0]], Math.max(1, width / 60))) {
    const [h] = at([value, 0]);
    plot.append(svg("path", { class: "axis", d: `M${h},${y}v4` }), svg("text", { x: h, y: y + 17, "text-anchor": "middle" }, fixed(value * 1e3, 0)));
  }
  for (const value of ticks(low[plane[1]], high[plane[1]], Math.max(1, height / 60))) {
    const [, v] = at([0, value]);
    plot.append(svg("path", { class: "axis", d: `M${left - 10},${v}h-4` }), svg("text", { x: left - 17, y: v + 4, "text-anchor": "end" }, fixed(value * 1e3, 0)));
  }
  const title = `seen along ${AXIS_NAMES[axis]}: ${names[0]} to the right, ${names[1]} up, mm`;
  plot.setAttribute("aria-label", `Outline of the object with its centre of mass, ${title}`);
  return make("figure", {}, plot, make("figcaption", { class: "muted" }, title));
}

/** The three views at one scale. */
export function outlineViews(history, newest) {
  const bounds = newest.bounds_m;
  if (!bounds) return [make("p", { class: "muted" }, "The outline of the object is not known.")];
  const longest = Math.max(...[0, 1, 2].map((axis) => bounds[1][axis] - bounds[0][axis]), 1e-4);
  const unit = (SIZE - MARGIN) / longest;
  const known = history.filter((each) => each.com_m && each.com_covariance_m2);
  return [0, 1, 2].map((axis) => view(axis, newest.hull?.[axis], bounds, known, unit));
}
