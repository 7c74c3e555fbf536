/** View Strike: verdict with the angle curve, list of strikes, orders for the next one. */

import { drawCurve } from "../curve.js";
import { confirm } from "../dialogs.js";
import { byId, make, rebuild, setDisabled, setText, show } from "../dom.js";
import {
  COUNTS_TEXT,
  countsAllTheSame,
  isRunning,
  isUseful,
  newestStrike,
  verdictText,
} from "../follow.js";
import { fixed, isNumber, sentence } from "../format.js";
import { get } from "../orders.js";
import { answer, pauseOrResume, skip } from "./place.js";

let page;
/** Strike whose curve is shown; null for the newest. */
let chosen = null;
const curves = new Map();

/** Connect the view's controls. */
export function connect(context) {
  page = context;
  for (const order of ["again", "harder"])
    byId(`order-${order}`).addEventListener("click", () => answer(order));
  byId("order-skip").addEventListener("click", skip);
  byId("order-pause").addEventListener("click", () => pauseOrResume("after_strike"));
  byId("order-abort").addEventListener("click", () =>
    confirm(
      "End the session?",
      "The striker is stopped. The recording so far is kept.",
      "End the session",
      () => page.order("/api/session/abort"),
    ),
  );
}

/** Main action of the view: Resume while the session is paused. */
export function action(snapshot) {
  if (snapshot.session?.paused)
    return { label: "Resume", problem: "", run: () => page.order("/api/session/resume") };
  if (snapshot.prompt) return { label: "Place the object", problem: "", run: page.follow };
  if (!snapshot.session || isRunning(snapshot.session)) return null;
  return { label: "Show the answer", problem: "", run: page.follow };
}

/** Curve of a strike: the data, null while it is loaded, or undefined if there is none. */
function curveOf(strike, session) {
  if (!strike?.curve) return undefined;
  const key = `${session.id}/${strike.id}`;
  if (curves.has(key)) return curves.get(key);
  curves.set(key, null);
  get(`/api/strikes/${encodeURIComponent(strike.id)}/curve`)
    .then((curve) => curves.set(key, curve))
    .catch(() => setTimeout(() => curves.delete(key), 2000))
    .finally(page.redraw);
  return null;
}

function drawVerdict(strike, session) {
  const good = isUseful(strike);
  setText(byId("verdict-title"), `${strike.id}: ${strike.edge}`);
  setText(byId("verdict-tag"), verdictText(strike.verdict));
  byId("verdict-tag").className = `tag ${good ? "pass" : "fail"}`;
  setText(byId("verdict-reason"), sentence(countsAllTheSame(strike, session) ? COUNTS_TEXT : strike.reason));
  const curve = curveOf(strike, session);
  const text = curve
    ? "Dots: measured angle. Line: fit. Shaded: window of the fit. Dashed: balance angle φ."
    : curve === null
      ? "The curve is being loaded."
      : "There is no curve of this strike.";
  setText(byId("curve-text"), text);
  rebuild(byId("verdict-facts"), strike, () =>
    [
      [
        "Balance angle φ",
        isNumber(strike.phi_deg) ? `${fixed(strike.phi_deg, 2)}° ± ${fixed(strike.phi_sd_deg, 3)}°` : "–",
      ],
      ["Energy ratio E", fixed(strike.energy_ratio, 2)],
      ["Used", strike.used ? "yes" : "no"],
    ].map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))),
  );
  const key = [session.id, strike.id, Boolean(curve)].join();
  show(byId("curve"), curve !== undefined);
  if (byId("curve").dataset.drawn !== key) {
    byId("curve").dataset.drawn = key;
    drawCurve(byId("curve"), curve ?? null);
  }
}

function row(strike, shown) {
  const open = make(
    "button",
    { type: "button", class: "link", "data-key": strike.id, "aria-pressed": strike.id === shown },
    strike.id,
  );
  open.addEventListener("click", () => {
    chosen = strike.id;
    page.redraw();
  });
  const tone = isUseful(strike) ? "pass" : "fail";
  return make(
    "tr",
    { class: strike.id === shown ? "chosen" : null },
    make("th", { scope: "row" }, open, make("span", { class: "edge muted" }, strike.edge)),
    make("td", {}, make("span", { class: `tag ${tone}` }, verdictText(strike.verdict))),
    make("td", { class: "n" }, fixed(strike.phi_deg, 2)),
    make("td", { class: "n" }, fixed(strike.phi_sd_deg, 3)),
    make("td", { class: "n" }, fixed(strike.energy_ratio, 2)),
  );
}

function drawOrders(snapshot, mayOrder) {
  const { session, prompt } = snapshot;
  const running = isRunning(session);
  const newest = newestStrike(snapshot);
  const asked = mayOrder && Boolean(prompt);
  setDisabled(byId("order-again"), !asked || !newest, "Possible when the session asks for a placement.");
  setDisabled(byId("order-harder"), !asked, "Possible when the session asks for a placement.");
  setDisabled(byId("order-skip"), !asked, "Possible when the session asks for a placement.");
  setDisabled(byId("order-pause"), !mayOrder || !running);
  setText(byId("order-pause"), session.paused && running ? "Resume" : "Pause after this strike");
  setDisabled(byId("order-abort"), !mayOrder || !running);
  const pausing = running && session.paused !== null && session.state !== "paused";
  const asks = prompt ? sentence(`Next: ${prompt.hint || prompt.text}`) : "";
  const waits =
    running && !prompt ? "Again, Harder and Skip are possible when the session asks for a placement." : asks;
  setText(byId("orders-note"), pausing ? "The session pauses before the next strike." : waits);
}

/** Draw the view. */
export function draw(snapshot, mayOrder) {
  const { session } = snapshot;
  const strikes = (session?.strikes ?? []).filter((strike) => strike.verdict);
  show(byId("strike-none"), !session);
  show(byId("strike-grid"), Boolean(session));
  if (!session) return;
  drawOrders(snapshot, mayOrder);
  const before = session.earlier > 0 ? `, after ${session.earlier} in earlier recordings` : "";
  setText(byId("strikes-progress"), `${session.done} of ${session.total}${before}`);
  const newest = strikes.at(-1);
  const shown = strikes.find((strike) => strike.id === chosen) ?? newest;
  rebuild(byId("strike-rows"), [strikes, shown?.id], () =>
    [...strikes].reverse().map((strike) => row(strike, shown?.id)),
  );
  for (const id of ["verdict-head", "verdict-reason", "verdict-facts", "curve", "curve-text"])
    show(byId(id), Boolean(shown));
  show(byId("verdict-none"), !shown);
  if (shown) drawVerdict(shown, session);
}

/** Show the newest strike again, as after a new verdict. */
export function showNewest() {
  chosen = null;
}
