/** View Archive: recordings as a table, filtered by text, with a comparison of two. */

import { byId, forget, make, rebuild, setDisabled, setText, show } from "../dom.js";
import { AXIS_NAMES } from "../ellipse.js";
import { bytes, counted, dateTime, decimalsFor, fixed, HALF_WIDTH_95, isNumber, signed } from "../format.js";
import { get } from "../orders.js";

const ESTIMATE_MS = 300000;

let page;
let entries = null;
let problem = "";
let selected = [];
const busy = new Set();

/** Connect the view's controls. */
export function connect(context) {
  page = context;
  byId("filter").addEventListener("input", page.redraw);
  byId("archive-refresh").addEventListener("click", load);
  byId("comparison-close").addEventListener("click", () => {
    selected = [];
    page.redraw();
  });
}

/** The view has no main action. */
export const action = () => null;

async function load() {
  try {
    entries = await get("/api/archive");
    problem = "";
  } catch (error) {
    problem = `${error.message} ${error.remedy}`;
  }
  selected = selected.filter((id) => entries?.some((each) => each.id === id));
  page.redraw();
}

async function estimate(id) {
  busy.add(id);
  forget(byId("archive-rows"));
  page.redraw();
  await page.order(`/api/archive/${encodeURIComponent(id)}/estimate`, {}, { timeout_ms: ESTIMATE_MS });
  busy.delete(id);
  forget(byId("archive-rows"));
  await load();
}

function select(id, on) {
  selected = selected.filter((each) => each !== id);
  if (on) selected = [...selected, id].slice(-2);
  page.redraw();
}

const halfWidths = (entry) =>
  AXIS_NAMES.map((_, axis) =>
    isNumber(entry.com_sd_mm?.[axis]) ? HALF_WIDTH_95 * entry.com_sd_mm[axis] : null,
  );

/** Cells of a centre of mass: one span per axis, so that the columns align. */
function comCells(entry) {
  if (!entry.com_mm) return [make("span", { class: "muted" }, "not estimated")];
  const halves = halfWidths(entry);
  const digits = decimalsFor(Math.min(...halves.filter((half) => half > 0)), 2);
  return AXIS_NAMES.map((name, axis) => {
    const half = halves[axis] === null ? "" : ` ± ${fixed(halves[axis], digits)}`;
    return make(
      "span",
      { class: "com" },
      make("i", {}, name),
      fixed(entry.com_mm[axis], digits),
      make("small", { class: "muted" }, half),
    );
  });
}

function row(entry, mayOrder) {
  const box = make("input", {
    type: "checkbox",
    "aria-label": `Compare ${entry.object} of ${dateTime(entry.date)}`,
    "data-key": `box-${entry.id}`,
  });
  box.checked = selected.includes(entry.id);
  box.addEventListener("change", () => select(entry.id, box.checked));
  const path = `/api/archive/${encodeURIComponent(entry.id)}`;
  const again = make(
    "button",
    { type: "button", "data-key": `estimate-${entry.id}` },
    busy.has(entry.id) ? "Estimating…" : entry.com_mm ? "Re-estimate" : "Estimate",
  );
  setDisabled(again, !mayOrder || busy.has(entry.id));
  again.addEventListener("click", () => estimate(entry.id));
  const flags = entry.flags ?? [];
  return make(
    "tr",
    { class: box.checked ? "chosen" : null },
    make("td", { class: "box" }, box),
    make(
      "th",
      { scope: "row" },
      entry.object,
      make("span", { class: "file muted" }, entry.file.split("/").at(-1)),
    ),
    make("td", { class: "date" }, dateTime(entry.date)),
    make(
      "td",
      { class: "n count", "data-label": "Strikes" },
      isNumber(entry.strikes) ? String(entry.strikes) : "–",
      entry.earlier_strikes > 0 ? make("small", { class: "muted" }, ` + ${entry.earlier_strikes}`) : "",
    ),
    make("td", { class: "n coms", "data-label": "Centre of mass [mm] ± 95 %" }, ...comCells(entry)),
    make(
      "td",
      {},
      make("div", { class: "flags" }, ...flags.map((flag) => make("span", { class: "tag warn" }, flag))),
    ),
    make("td", { class: "n size", "data-label": "Size" }, bytes(entry.size_bytes)),
    make(
      "td",
      { class: "acts" },
      make("a", { class: "button", href: `${path}/report`, target: "_blank", rel: "noopener" }, "Report"),
      make("a", { class: "button", href: `${path}/download`, download: "" }, "Download"),
      again,
    ),
  );
}

/** Difference of two centres of mass and the 95 % half width of that difference, per axis [mm]. */
export function difference(a, b) {
  return AXIS_NAMES.map((_, axis) => {
    const known = a.com_mm && b.com_mm;
    const sds = [a.com_sd_mm?.[axis], b.com_sd_mm?.[axis]];
    return {
      value: known ? b.com_mm[axis] - a.com_mm[axis] : null,
      half: sds.every(isNumber) ? HALF_WIDTH_95 * Math.hypot(...sds) : null,
    };
  });
}

function drawComparison() {
  const pair = selected.map((id) => entries?.find((each) => each.id === id)).filter(Boolean);
  show(byId("comparison"), pair.length === 2);
  if (pair.length !== 2) return;
  const [a, b] = pair;
  const differences = difference(a, b);
  const title = (entry) =>
    make(
      "th",
      { scope: "col", class: "n" },
      entry.object,
      make("span", { class: "muted file" }, dateTime(entry.date)),
    );
  rebuild(byId("compare-head"), pair, () => [
    make(
      "tr",
      {},
      make("th", { scope: "col" }, "mm ± 95 %"),
      title(a),
      title(b),
      make("th", { scope: "col", class: "n" }, "Difference"),
    ),
  ]);
  rebuild(byId("compare-rows"), pair, () =>
    AXIS_NAMES.map((name, axis) => {
      const cell = (value, half, show_sign) => {
        const digits = decimalsFor(half, 2);
        const around = isNumber(half) ? ` ± ${fixed(half, digits)}` : "";
        return make(
          "td",
          { class: "n" },
          (show_sign ? signed : fixed)(value, digits),
          make("small", { class: "muted" }, around),
        );
      };
      const { value, half } = differences[axis];
      return make(
        "tr",
        {},
        make("th", { scope: "row" }, name),
        cell(a.com_mm?.[axis], halfWidths(a)[axis]),
        cell(b.com_mm?.[axis], halfWidths(b)[axis]),
        cell(value, half, true),
      );
    }),
  );
  const beyond = AXIS_NAMES.filter(
    (_, axis) =>
      isNumber(differences[axis].value) && Math.abs(differences[axis].value) > differences[axis].half,
  );
  const known = differences.every((each) => isNumber(each.value) && isNumber(each.half));
  const verdict =
    beyond.length === 0
      ? "The two agree within their 95 % intervals on every axis."
      : `They differ beyond the 95 % interval along ${beyond.join(", ")}.`;
  setText(byId("compare-text"), known ? verdict : "One of the two is not estimated: press Estimate.");
}

const textOf = (entry) =>
  [
    entry.object,
    entry.date,
    dateTime(entry.date),
    entry.file,
    ...(entry.flags ?? []),
  ]
    .join(" ")
    .toLowerCase();

/** Draw the view. */
export function draw(snapshot, mayOrder) {
  const words = byId("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
  const shown = (entries ?? []).filter((entry) => words.every((word) => textOf(entry).includes(word)));
  setText(byId("archive-count"), entries ? `${shown.length} of ${counted(entries.length, "recording")}` : "");
  show(byId("archive"), shown.length > 0);
  show(byId("archive-none"), shown.length === 0);
  const empty =
    entries?.length === 0 ? "The folder of recordings is empty." : "No recording matches the filter.";
  setText(byId("archive-none"), problem || (entries ? empty : "Loading…"));
  rebuild(byId("archive-rows"), [shown, selected, mayOrder], () =>
    shown.map((entry) => row(entry, mayOrder)),
  );
  drawComparison();
}

/** Load the list whenever the view is opened. */
export function opened() {
  load();
}
