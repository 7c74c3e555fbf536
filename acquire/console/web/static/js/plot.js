/** Axes and lines of small SVG plots. */

import { svg } from "./dom.js";
import { fixed } from "./format.js";

/** Ticks at round values (1, 2 or 5 times a power of ten) from low to high: 0.5 to 1.5 times `count`. */
export function ticks(low, high, count = 5) {
  const span = high - low;
  if (!(span > 0)) return [low];
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each * 1.5 >= raw);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
}

/** Decimals with which ticks of this spacing are written. */
export const tickDecimals = (values) =>
  values.length < 2 ? 1 : Math.max(0, Math.min(4, -Math.floor(Math.log10(values[1] - values[0]) + 1e-9)));

/** Linear map from data to pixels. */
export const scale =
  ([low, high], [from, to]) =>
  (value) =>
    from + ((value - low) / (high - low || 1)) * (to - from);

/** Points of a polyline, with one decimal. */
export const points = (xs, ys, x, y) =>
  xs.map((value, i) => `${x(value).toFixed(1)},${y(ys[i]).toFixed(1)}`).join(" ");

/**
 * Frame of a plot: grid, tick labels and axis titles; `area` is [left, top, right, bottom] in pixels.
 *
 * Each axis is {range, title, ticks?, labels?}. Returns the group and the two maps from data to pixels.
 */
export function axes([left, top, right, bottom], horizontal, vertical) {
  const x = scale(horizontal.range, [left, right]);
  const y = scale(vertical.range, [bottom, top]);
  const group = svg("g", { class: "axes" });
  const xs = horizontal.ticks ?? ticks(...horizontal.range, 6);
  const ys = vertical.ticks ?? ticks(...vertical.range, 5);
  xs.forEach((value, i) => {
    group.append(svg("line", { class: "grid", x1: x(value), x2: x(value), y1: top, y2: bottom }));
    const text = horizontal.labels?.[i] ?? fixed(value, tickDecimals(xs));
    group.append(svg("text", { x: x(value), y: bottom + 20, "text-anchor": "middle" }, text));
  });
  ys.forEach((value, i) => {
    group.append(svg("line", { class: "grid", x1: left, x2: right, y1: y(value), y2: y(value) }));
    const text = vertical.labels?.[i] ?? fixed(value, tickDecimals(ys));
    group.append(svg("text", { x: left - 8, y: y(value) + 5, "text-anchor": "end" }, text));
  });
  group.append(svg("path", { class: "axis", d: `M${left},${top}V${bottom}H${right}` }));
  group.append(
    svg("text", { class: "title", x: right, y: bottom + 40, "text-anchor": "end" }, horizontal.title),
  );
  group.append(svg("text", { class: "title", x: left - 40, y: top - 12 }, vertical.title));
  return { group, x, y };
}

/** Lowest and highest finite value of all arrays. */
export function extent(...arrays) {
  const values = arrays.flat().filter(Number.isFinite);
  return values.length > 0 ? [Math.min(...values), Math.max(...values)] : [0, 1];
}
