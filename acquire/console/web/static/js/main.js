/** Start of the page: connection, views, keys, and what all views share. */

import { Connection } from "./connection.js";
import { connectDialogs, isDialogOpen } from "./dialogs.js";
import { byId, make, rebuild, setAttribute, setDisabled, setText, show } from "./dom.js";
import { isRunning, newestStrike, signFor, viewFor, VIEWS } from "./follow.js";
import { estimatesOf } from "./history.js";
import { sentence } from "./format.js";
import { connectKeys } from "./keys.js";
import { connectOperator, drawOperator } from "./operator.js";
import { OrderError, post } from "./orders.js";
import { beep, isSoundOn, setSound } from "./sound.js";
import { drawStatus } from "./status.js";
import { connectStop, drawStop } from "./stop.js";
import * as archive from "./views/archive.js";
import * as know from "./views/know.js";
import * as place from "./views/place.js";
import * as ready from "./views/ready.js";
import * as strike from "./views/strike.js";

const VIEW_MODULES = { ready, place, strike, know, archive };
/** Time for which a new verdict stays on the sign [ms]. */
const VERDICT_MS = 4000;
const LINK_TEXTS = {
  lost: [
    "Connection to the console lost",
    "The session pauses before its next strike. The page reconnects by itself. Until then, stop at the striker's switch or plug.",
  ],
  refused: [
    "This browser is not let in",
    "The console was started again, or this browser never had its address. Open the address that `acquire console` prints; each works once.",
  ],
};

const NO_LINK = { word: "NO LINK", tone: "bad", text: "Stop at the striker's switch or plug." };

let snapshot = null;
let link = "";
let view = "ready";
let pinned = false;
let verdict_until_ms = 0;
let session_id = null;
let newest_key = null;
let sign_word = "";
let frame = 0;
/** What an order that takes seconds does meanwhile, and the word of its sign if the arm moves; or null. */
let doing = null;
/** Trouble that the operator has read, as JSON; other trouble is shown again. */
let dismissed = "";

const mayOrder = () => link === "open" && snapshot?.role === "operator";
const verdictIsNew = () => Date.now() < verdict_until_ms;

/**
 * Send an order and show its refusal; returns the answer, or null if it was refused.
 *
 * `slow` is for orders that take seconds: its `text` is shown meanwhile, as a sign if it has a `word`;
 * `timeout_ms` is the longest wait.
 */
async function order(path, content = {}, slow = {}) {
  try {
    if (slow.text) doing = slow;
    redraw();
    const answer = await post(path, content, slow.timeout_ms);
    show(byId("refusal"), false);
    return answer ?? {};
  } catch (error) {
    if (!(error instanceof OrderError)) throw error;
    setText(byId("refusal-title"), error.message);
    setText(byId("refusal-text"), error.remedy);
    show(byId("refusal"), true);
    return null;
  } finally {
    if (slow.text) doing = null;
    redraw();
  }
}

/** Draw once in the next frame, however often this is called. */
function redraw() {
  if (frame === 0) frame = requestAnimationFrame(draw);
}

/** Keep the view in the address, and beside it whether it was chosen by hand: a reload follows as before. */
const remember = () => history.replaceState({ pinned }, "", `#${view}`);

function setView(next) {
  if (next === view) return;
  const last = view;
  view = next;
  remember();
  VIEW_MODULES[view].opened?.();
  redraw();
  // Focus must not stay on a control of a hidden view, nor on one that Enter would press.
  if (byId(`view-${last}`).contains(document.activeElement) || document.activeElement === byId("action"))
    document.activeElement.blur();
  scrollTo({ top: 0 });
}

/** Go to a view and stay there until the operator follows the session again. */
function pin(next) {
  pinned = next !== (snapshot && viewFor(snapshot, verdictIsNew()));
  setView(next);
  remember();
  byId(`${view}-title`).focus({ preventScroll: true });
  redraw();
}

/** Follow the session: its step chooses the view, and the last verdict no longer holds it. */
function follow() {
  pinned = false;
  verdict_until_ms = 0;
  applyFollow();
  remember();
  redraw();
}

/** Offer a session in Ready that goes on with the one that has ended; `id` is its recording's. */
function goOn(session, id) {
  ready.offer(session, id);
  pin("ready");
}

function applyFollow() {
  const wanted = snapshot && viewFor(snapshot, verdictIsNew());
  if (!pinned && wanted) setView(wanted);
}

function drawSign() {
  const moves = doing?.word ? { word: doing.word, tone: "armed", text: doing.text } : null;
  const sign = link === "open" ? (moves ?? signFor(snapshot, verdictIsNew())) : NO_LINK;
  const large = document.body.classList.contains("large");
  const stated = sign === NO_LINK || sign.word === "STOPPED" || !snapshot.session;
  const ended = view === "know" && !isRunning(snapshot?.session);
  const followed = ["place", "strike"].includes(view) || ended;
  show(byId("sign"), large || sign.tone === "armed" || (followed && !stated));
  byId("sign").dataset.tone = sign.tone;
  setText(byId("sign-word"), sign.word);
  setText(byId("sign-text"), sentence(sign.text));
  if (sign.word === sign_word) return;
  sign_word = sign.word;
  beep(sign.word);
  setText(byId("live"), `${sign.word}. ${sentence(sign.text)}`);
}

function drawBanners() {
  const texts = LINK_TEXTS[link];
  show(byId("link-lost"), Boolean(texts));
  if (texts) {
    setText(byId("link-title"), texts[0]);
    setText(byId("link-text"), texts[1]);
  }
  show(byId("doing"), doing !== null && !doing.word);
  setText(byId("doing-text"), doing?.text ?? "");
  const trouble = snapshot?.trouble ?? [];
  show(byId("trouble"), trouble.length > 0 && JSON.stringify(trouble) !== dismissed);
  rebuild(byId("trouble-list"), trouble, () => trouble.map((text) => make("li", {}, text)));
  const signed = document.body.classList.contains("large") || ["place", "strike"].includes(view);
  const paused = snapshot?.session?.state === "paused" && !signed && !snapshot.stop.stopped;
  show(byId("paused"), paused);
  if (paused) setText(byId("paused-text"), sentence(snapshot.session.paused) || "Press Resume to go on.");
}

function currentAction() {
  if (!snapshot) return null;
  const wanted = VIEW_MODULES[view].action(snapshot);
  if (!wanted) return null;
  const watching = snapshot.role === "operator" ? "" : "You are watching.";
  const stopped = snapshot.stop?.stopped && view !== "know" ? "Home the striker first." : "";
  if (isDialogOpen()) return { ...wanted, problem: "Close the dialog first." };
  if (doing) return { ...wanted, problem: doing.text };
  return {
    ...wanted,
    problem: watching || (link === "open" ? "" : "No connection.") || stopped || wanted.problem,
  };
}

function drawAction() {
  const wanted = currentAction();
  show(byId("action"), wanted !== null);
  if (!wanted) return;
  setText(byId("action-label"), wanted.label);
  setDisabled(byId("action"), wanted.problem !== "", wanted.problem);
}

/** Run the view's main action if it is possible now. */
function act() {
  const wanted = currentAction();
  if (wanted && wanted.problem === "" && !isDialogOpen()) wanted.run();
}

function drawFrame() {
  for (const name of VIEWS) show(byId(`view-${name}`), name === view);
  const followed = snapshot && viewFor(snapshot, verdictIsNew());
  for (const anchor of document.querySelectorAll("[data-view]")) {
    setAttribute(anchor, "aria-current", anchor.dataset.view === view ? "page" : null);
    anchor.classList.toggle("followed", isRunning(snapshot?.session) && anchor.dataset.view === followed);
  }
  show(byId("follow"), pinned && isRunning(snapshot?.session));
  setText(byId("session-name"), snapshot?.session ? snapshot.session.object : "");
  const names = { ready: "Ready", place: "Place", strike: "Strike", know: "Know", archive: "Archive" };
  document.title =
    sign_word && isRunning(snapshot?.session) ? `${sign_word} – Percuss` : `${names[view]} – Percuss`;
}

function draw() {
  frame = 0;
  drawFrame();
  drawBanners();
  drawStatus(byId("status"), snapshot, link);
  const stopped = drawStop(snapshot, mayOrder(), Boolean(doing?.word));
  document.body.classList.toggle("is-stopped", stopped);
  drawOperator(snapshot, link);
  if (snapshot) {
    drawSign();
    VIEW_MODULES[view].draw(snapshot, mayOrder());
  }
  // After the view: the action depends on what its form holds.
  drawAction();
  if (!snapshot) return;
  for (const [name, module] of Object.entries(VIEW_MODULES))
    module.setVisible?.(name === view && link === "open", snapshot);
}

function onState(received) {
  snapshot = received;
  estimatesOf(snapshot);
  const newest = newestStrike(snapshot);
  const key = newest && `${snapshot.session.id}/${newest.id}/${newest.verdict}`;
  // Verdicts of a session that the page sees for the first time are not new.
  if (key && key !== newest_key && snapshot.session.id === session_id) {
    verdict_until_ms = Date.now() + VERDICT_MS;
    strike.showNewest();
    setTimeout(() => {
      applyFollow();
      redraw();
    }, VERDICT_MS + 50);
  }
  newest_key = key;
  session_id = snapshot.session?.id ?? null;
  applyFollow();
  redraw();
}

function onLink(state) {
  link = state;
  if (state === "lost" && snapshot) beep("CONNECTION LOST");
  redraw();
}

function toggleLarge() {
  const large = document.body.classList.toggle("large");
  byId("large").setAttribute("aria-pressed", String(large));
  redraw();
}

function toggleSound() {
  setSound(!isSoundOn());
  byId("sound").setAttribute("aria-pressed", String(isSoundOn()));
}

function start() {
  const context = { order, redraw, goTo: pin, follow, goOn, latest: () => snapshot };
  for (const module of Object.values(VIEW_MODULES)) module.connect(context);
  connectDialogs(redraw);
  connectOperator(order);
  connectStop(redraw, order);
  connectKeys({ act, follow, toggleLarge, toggleSound, goTo: pin });
  byId("action").addEventListener("click", act);
  byId("follow").addEventListener("click", follow);
  byId("large").addEventListener("click", toggleLarge);
  byId("sound").addEventListener("click", toggleSound);
  byId("sound").setAttribute("aria-pressed", String(isSoundOn()));
  byId("trouble-close").addEventListener("click", () => {
    dismissed = JSON.stringify(snapshot?.trouble ?? []);
    redraw();
  });
  byId("refusal-close").addEventListener("click", () => show(byId("refusal"), false));
  for (const anchor of document.querySelectorAll("[data-view]"))
    anchor.addEventListener("click", (event) => {
      event.preventDefault();
      pin(anchor.dataset.view);
    });
  const wanted = location.hash.slice(1);
  if (VIEWS.includes(wanted) && wanted !== "ready") {
    pinned = history.state?.pinned !== false;
    view = wanted;
    VIEW_MODULES[view].opened?.();
  }
  addEventListener("hashchange", () => VIEWS.includes(location.hash.slice(1)) && pin(location.hash.slice(1)));
  redraw();
  new Connection(onState, onLink).run();
}

start();
