/**
 * Outlines of the object seen along x, y and z, with the 95 % ellipses of its centre of mass.
 *
 * The ellipses are a hundredth of the object's size: a magnified inset beside each outline shows them.
 */

import { make, svg } from "./dom.js";
import { AXIS_NAMES, ellipse95, openAxes, VIEW_AXES, widened } from "./ellipse.js";
import { fixed, millimetres } from "./format.js";
import { ticks } from "./plot.js";

/** Length of the object's longest side [px], and free space left of and around the outline. */
const LONGEST = 220;
const LEFT = 40;
const TOP = 10;
const LENS_RADIUS = 62;
/** Share of the inset's radius that the largest ellipse in it takes. */
const LENS_FILL = 0.86;
/** Magnification below which there is no inset. */
const LEAST_MAGNIFICATION = 2;
/** Earlier estimates that are drawn. */
const EARLIER = 4;
const MAGNIFICATIONS = [2, 5, 10, 20, 50, 100, 200, 500, 1000];

let clips = 0;

function ellipse(estimate, plane, [cx, cy], unit, name) {
  const { long_m, short_m, angle } = ellipse95(widened(estimate.com_covariance_m2, estimate.com_open), plane);
  return svg("ellipse", {
    class: name,
    cx,
    cy,
    rx: Math.max(long_m * unit, 0.8),
    ry: Math.max(short_m * unit, 0.8),
    transform: `rotate(${(-angle * 180) / Math.PI} ${cx} ${cy})`,
  });
}

/** Ellipses from old to new, clipped to a shape; `at` maps a point of the plane to pixels. */
function ellipses(estimates, plane, at, unit, shape) {
  clips += 1;
  const id = `clip-${clips}`;
  const drawn = estimates.map((each, i) => {
    const age = estimates.length - 1 - i;
    return ellipse(
      each,
      plane,
      at(plane.map((axis) => each.com_m[axis])),
      unit,
      age === 0 ? "now" : `before age-${age}`,
    );
  });
  return [svg("clipPath", { id }, shape), svg("g", { "clip-path": `url(#${id})` }, ...drawn)];
}

const cross = (x, y, size) =>
  svg("path", { class: "centre", d: `M${x - size},${y}h${2 * size}M${x},${y - size}v${2 * size}` });

/** Largest round magnification at which the ellipses fit into the inset; 0 if they need none. */
function magnification(estimates, plane, unit) {
  const newest = estimates.at(-1);
  const reach = (each) => {
    const { long_m } = ellipse95(each.com_covariance_m2, plane);
    return long_m + Math.hypot(...plane.map((axis) => each.com_m[axis] - newest.com_m[axis]));
  };
  // The ellipse before the newest must fit; older ones may be cut.
  const largest = Math.max(...estimates.slice(-2).map(reach));
  const wanted = (LENS_FILL * LENS_RADIUS) / (largest * unit);
  return wanted < LEAST_MAGNIFICATION ? 0 : MAGNIFICATIONS.findLast((each) => each <= wanted);
}

/** Inset around the centre of mass: ellipses, a scale, and a line to the place that it magnifies. */
function lens(estimates, plane, [cx, cy], [x, y], unit) {
  const times = magnification(estimates, plane, unit);
  if (!times) return [];
  const newest = estimates.at(-1);
  const large = unit * times;
  const at = ([h, v]) => [x + (h - newest.com_m[plane[0]]) * large, y - (v - newest.com_m[plane[1]]) * large];
  const circle = () => svg("circle", { cx: x, cy: y, r: LENS_RADIUS });
  const back = circle();
  back.setAttribute("class", "lens");
  const bar_m = ticks(0, (1.3 * LENS_RADIUS) / large, 2).at(1) ?? LENS_RADIUS / large;
  const bar = bar_m * large;
  return [
    svg("circle", { class: "ring", cx, cy, r: Math.max(4, LENS_RADIUS / times) }),
    svg("line", {
      class: "lead",
      x1: cx + Math.max(4, LENS_RADIUS / times),
      y1: cy,
      x2: x - LENS_RADIUS,
      y2: y,
    }),
    back,
    ...ellipses(estimates, plane, at, large, circle()),
    cross(x, y, 5),
    svg("path", { class: "axis", d: `M${x - bar / 2},${y + LENS_RADIUS + 9}v5h${bar}v-5` }),
    svg(
      "text",
      { x, y: y + LENS_RADIUS + 28, "text-anchor": "middle" },
      millimetres(bar_m, bar_m < 1e-3 ? 1 : 0),
    ),
  ];
}

function axis(left, top, width, height, low, high, plane, unit) {
  const bottom = top + height + 8;
  const parts = [
    svg("path", { class: "axis", d: `M${left},${bottom}h${width}M${left - 8},${top}v${height}` }),
  ];
  for (const value of ticks(low[plane[0]], high[plane[0]], Math.max(1, width / 55))) {
    const x = left + (value - low[plane[0]]) * unit;
    parts.push(svg("path", { class: "axis", d: `M${x},${bottom}v4` }));
    parts.push(svg("text", { x, y: bottom + 17, "text-anchor": "middle" }, fixed(value * 1e3, 0)));
  }
  for (const value of ticks(low[plane[1]], high[plane[1]], Math.max(1, height / 55))) {
    const y = top + (high[plane[1]] - value) * unit;
    parts.push(svg("path", { class: "axis", d: `M${left - 8},${y}h-4` }));
    parts.push(svg("text", { x: left - 15, y: y + 4, "text-anchor": "end" }, fixed(value * 1e3, 0)));
  }
  return parts;
}

/** Names of the markers that face the viewer, at their places. */
function markers(sides, along, plane, at) {
  // The views along x and z are seen from their positive ends, the one along y from its negative end.
  const towards = along === 1 ? -1 : 1;
  return sides
    .filter((each) => towards * each.faces[along] > 0.7)
    .map((each) => {
      const [x, y] = at(plane.map((axis) => each.place_m[axis]));
      return svg("text", { class: "marker", x, y: y + 4, "text-anchor": "middle" }, `tag ${each.id}`);
    });
}

/** One view; `estimates` from old to new, all with a centre of mass. */
function view(along, hull, [low, high], estimates, unit, sides) {
  const plane = VIEW_AXES[along];
  const spans = plane.map((each) => high[each] - low[each]);
  const [width, height] = spans.map((span) => span * unit);
  const top = TOP + Math.max(0, LENS_RADIUS - height / 2);
  const at = ([h, v]) => [LEFT + (h - low[plane[0]]) * unit, top + (high[plane[1]] - v) * unit];
  const box = [
    [0, 0],
    [1, 0],
    [1, 1],
    [0, 1],
  ].map(([a, b]) => [low[plane[0]] + a * spans[0], low[plane[1]] + b * spans[1]]);
  const corners = (hull?.length > 2 ? hull : box).map((each) =>
    at(each)
      .map((value) => value.toFixed(1))
      .join(","),
  );
  const parts = [
    svg("polygon", { class: "body", points: corners.join(" ") }),
    ...axis(LEFT, top, width, height, low, high, plane, unit),
    ...markers(sides, along, plane, at),
  ];
  if (estimates.length > 0) {
    const centre = at(plane.map((each) => estimates.at(-1).com_m[each]));
    const inside = svg("rect", { x: LEFT - 8, y: top - 8, width: width + 16, height: height + 16 });
    parts.push(...ellipses(estimates, plane, at, unit, inside), cross(...centre, 5));
    const hidden = openAxes(estimates.at(-1).com_open);
    const known = plane.every((each) => !hidden.includes(AXIS_NAMES[each]));
    if (known)
      parts.push(
        ...lens(estimates, plane, centre, [LEFT + width + 28 + LENS_RADIUS, top + height / 2], unit),
      );
  }
  const [h, v] = plane.map((each) => AXIS_NAMES[each]);
  const title = `${h} to the right, ${v} up [mm], seen from ${["+x", "−y", "+z"][along]}`;
  const size = [
    LEFT + LONGEST + 2 * LENS_RADIUS + 34,
    Math.max(top + height + 32, top + height / 2 + LENS_RADIUS + 36),
  ];
  const plot = svg("svg", { viewBox: `0 0 ${size[0]} ${size[1].toFixed(0)}`, role: "img" }, ...parts);
  plot.setAttribute("aria-label", `Outline of the object with the centre of mass: ${title}`);
  return make("figure", {}, plot, make("figcaption", { class: "muted" }, title));
}

/** The three views at one scale. */
export function outlineViews(history, newest) {
  const bounds = newest.bounds_m;
  if (!bounds) return [make("p", { class: "muted" }, "The outline of the object is not known.")];
  const longest = Math.max(...[0, 1, 2].map((each) => bounds[1][each] - bounds[0][each]), 1e-4);
  const known = history.filter((each) => each.com_m && each.com_covariance_m2).slice(-EARLIER - 1);
  return [0, 1, 2].map((along) => view(along, newest.hull?.[along], bounds, known, LONGEST / longest, newest.markers ?? []));
}
