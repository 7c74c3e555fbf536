/** View Know: estimate after each strike, target and forecast, next strike. */

import { byId, make, rebuild, setText, show, svg } from "../dom.js";
import { AXIS_NAMES, openAxes } from "../ellipse.js";
import { isRunning } from "../follow.js";
import {
  commonPower,
  counted,
  decimalsFor,
  fixed,
  HALF_WIDTH_95,
  isNumber,
  millimetres,
  percent,
  powerText,
  sentence,
} from "../format.js";
import { estimatesOf } from "../history.js";
import { get } from "../orders.js";
import { outlineViews } from "../outlines.js";
import { axes, points } from "../plot.js";
import { checkItems } from "./checks.js";

/** Places of xx, yy, zz, xy, xz, yz in the symmetric matrix. */
const PLACES = [
  [0, 3, 4],
  [3, 1, 5],
  [4, 5, 2],
];
const AREA = [54, 30, 408, 122];

/** Time after which the ended session's recording is looked for again [ms]. */
const ARCHIVE_RETRY_MS = 3000;

const FOLLOWS = "The first estimate follows the first good strikes.";
const NONE = "No estimate was made during the session. The report makes one from the recording.";

let page;
let recording = { file: null, id: null };

/** Connect the view. */
export function connect(context) {
  page = context;
}

/** Main action of the view: go to the next session when one has ended. */
export function action(snapshot) {
  if (isRunning(snapshot.session)) {
    return {
      label: snapshot.prompt ? "Place the object" : "Show the strike",
      problem: "",
      run: page.follow,
    };
  }
  const { session } = snapshot;
  if (session?.state !== "aborted")
    return { label: "Next session", problem: "", run: () => page.goTo("ready") };
  const id = recordingId(session);
  return {
    label: "Go on with it",
    problem: id === null ? "The recording is being finished." : "",
    run: () => page.goOn(session, id),
  };
}

function drawCom(estimate) {
  const { com_m: com, com_covariance_m2: covariance } = estimate;
  const open = openAxes(estimate.com_open);
  const halves = [0, 1, 2].map((axis) =>
    covariance ? HALF_WIDTH_95 * Math.sqrt(Math.max(0, covariance[axis][axis])) * 1e3 : null,
  );
  const digits = decimalsFor(Math.min(...halves.filter((half) => half > 0)), 2);
  rebuild(byId("com-values"), [com, covariance], () =>
    AXIS_NAMES.map((name, axis) => {
      const half = halves[axis];
      const unknown = !com || (estimate.com_open ?? []).some((each) => Math.abs(each[axis]) > 0.4);
      const value = unknown ? "not known" : fixed(com[axis] * 1e3, digits);
      const around = unknown || half === null ? "" : `± ${fixed(half, digits)} mm`;
      return make(
        "div",
        {},
        make("dt", {}, name),
        make("dd", { class: unknown ? "muted" : null }, value),
        make("dd", { class: "muted" }, around),
      );
    }),
  );
  setText(
    byId("com-open"),
    open ? `Not known along ${open} yet: edges of another direction are needed.` : "",
  );
}

function drawTensor(estimate) {
  const { inertia_kg_m2: tensor, inertia_sd_kg_m2: sds } = estimate;
  show(byId("tensor").parentElement, Boolean(tensor));
  show(byId("tensor-none"), !tensor);
  setText(byId("tensor-unit"), "");
  if (!tensor) return;
  const power = commonPower(tensor);
  const unit = 10 ** power;
  setText(byId("tensor-unit"), `${powerText(power)} kg m², about the centre of mass, ± 95 %`);
  const halves = (sds ?? []).map((sd) => (HALF_WIDTH_95 * sd) / unit);
  const digits = decimalsFor(Math.min(...halves.filter((half) => half > 0)), 3);
  rebuild(byId("tensor"), [tensor, sds], () => [
    make("tr", {}, make("td"), ...AXIS_NAMES.map((name) => make("th", { scope: "col", class: "n" }, name))),
    ...PLACES.map((row, i) =>
      make(
        "tr",
        {},
        make("th", { scope: "row" }, AXIS_NAMES[i]),
        ...row.map((place) =>
          make(
            "td",
            {},
            fixed(tensor[place] / unit, digits),
            make("small", { class: "muted" }, sds ? ` ± ${fixed(halves[place], digits)}` : ""),
          ),
        ),
      ),
    ),
  ]);
}

/** Sentence on the target: value reached, value wanted, and the number of strikes still needed. */
export function targetText(estimate, running) {
  const { target, forecast } = estimate;
  const parts = [];
  if (isNumber(target?.com_m))
    parts.push(
      `centre of mass ± ${millimetres(estimate.com_half_width_m)} of ± ${millimetres(target.com_m)}`,
    );
  if (isNumber(target?.inertia))
    parts.push(`inertia ± ${percent(estimate.inertia_half_width)} of ± ${percent(target.inertia)}`);
  if (parts.length === 0) return "No target: the session makes all strikes of the plan.";
  const wanted = parts.join(", ");
  if (target.met) return `Target met: ${wanted}.`;
  if (target.reachable === false) return `The target cannot be reached with this object: ${wanted}.`;
  if (!forecast || !running) return `So far: ${wanted}.`;
  const { least, most } = forecast;
  const range = least === most ? counted(least, "more strike") : `${least} to ${most} more strikes`;
  return `${range}. So far: ${wanted}.`;
}

function drawProgress(history, estimate) {
  const known = history.filter((each) => isNumber(each.com_half_width_m) && each.com_half_width_m > 0);
  const target = estimate.target?.com_m;
  show(byId("progress").parentElement, known.length > 0);
  if (known.length === 0) return;
  const logs = known.map((each) => Math.log10(each.com_half_width_m * 1e3));
  const wanted = isNumber(target) ? Math.log10(target * 1e3) : null;
  const all = wanted === null ? logs : [...logs, wanted];
  const range = [Math.min(...all) - 0.15, Math.max(...all) + 0.15];
  const values = [0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].filter(
    (mm) => Math.log10(mm) >= range[0] && Math.log10(mm) <= range[1],
  );
  const strikes = known.map((each) => each.strikes);
  const to = Math.max(...strikes, (estimate.strikes ?? 0) + (estimate.forecast?.most ?? 0)) + 0.4;
  const from = Math.min(...strikes) - 0.4;
  const whole = Array.from({ length: Math.floor(to) - Math.ceil(from) + 1 }, (_, i) => Math.ceil(from) + i);
  rebuild(byId("progress"), [known, wanted, estimate.forecast], () => {
    const { group, x, y } = axes(
      AREA,
      { range: [from, to], title: "strikes", ticks: whole },
      { range, title: "half width, 95 % [mm]", ticks: values.map(Math.log10), labels: values.map(String) },
    );
    const parts = [group];
    if (wanted !== null) {
      parts.push(svg("line", { class: "phi", x1: AREA[0], x2: AREA[2], y1: y(wanted), y2: y(wanted) }));
      parts.push(svg("text", { class: "phi-label", x: AREA[0] + 8, y: y(wanted) - 6 }, "target"));
    }
    parts.push(svg("polyline", { class: "fit", points: points(strikes, logs, x, y) }));
    parts.push(
      svg(
        "g",
        { class: "measured" },
        ...logs.map((log, i) => svg("circle", { cx: x(strikes[i]), cy: y(log), r: 4 })),
      ),
    );
    return parts;
  });
}

function drawNext(snapshot, estimate) {
  const running = isRunning(snapshot.session);
  const next = estimate.next ? `${estimate.next.strike_id}: ${estimate.next.reason}` : "No strike is left.";
  setText(byId("next-text"), running ? next : "The session has ended.");
}

/** Id of the session's recording in the archive; looked up once the session has ended. */
function recordingId(session) {
  if (!session || isRunning(session) || !session.file) return null;
  if (recording.file === session.file) return recording.id;
  recording = { file: session.file, id: null };
  const name = (path) => path.split("/").at(-1);
  get("/api/archive")
    .then((entries) => {
      const found = entries.find((each) => name(each.file) === name(session.file));
      recording.id = found?.id ?? null;
    })
    .catch(() => {})
    .finally(() => {
      // The recording gets its name when it is complete: ask again until it is there.
      if (recording.id === null)
        setTimeout(() => {
          recording.file = null;
          page.redraw();
        }, ARCHIVE_RETRY_MS);
    })
    .finally(page.redraw);
  return null;
}

function drawLinks(session) {
  const id = recordingId(session);
  show(byId("know-links"), id !== null);
  rebuild(byId("know-links"), [id, session?.file], () => {
    const link = (text, path, more) =>
      make("a", { class: "button", href: `/api/archive/${encodeURIComponent(id)}/${path}`, ...more }, text);
    if (id === null) return [];
    return [
      link("Report", "report", { target: "_blank", rel: "noopener" }),
      link("Download the recording", "download", { download: "" }),
      make(
        "span",
        { class: "replay muted" },
        "Replay: ",
        make("code", {}, `analyze replay ${session?.file}`),
      ),
    ];
  });
}

function lead(session, estimate) {
  if (!estimate || !isRunning(session)) return "";
  return `After ${counted(estimate.strikes, "good strike")}.`;
}

/** Draw the view. */
export function draw(snapshot) {
  const { session, estimate } = snapshot;
  const history = estimatesOf(snapshot);
  setText(byId("know-lead"), lead(session, estimate));
  drawLinks(session);
  show(byId("know-none"), !estimate);
  setText(byId("know-none"), isRunning(session) ? FOLLOWS : session ? NONE : "No session yet.");
  show(byId("know-grid"), Boolean(estimate));
  if (!estimate) return;
  drawCom(estimate);
  drawTensor(estimate);
  setText(byId("target-text"), targetText(estimate, isRunning(session)));
  setText(byId("target-reason"), sentence(estimate.target?.reason));
  drawProgress(history, estimate);
  drawNext(snapshot, estimate);
  rebuild(byId("outlines"), [history.slice(-5), estimate.hull], () => outlineViews(history, estimate));
  const lines = (estimate.checks ?? []).map((each) => ({
    name: each.name,
    outcome: each.passed ? "pass" : "fail",
    text: each.text,
  }));
  rebuild(byId("estimate-checks"), lines, () => checkItems(lines));
  show(byId("checks-none"), lines.length === 0);
}
