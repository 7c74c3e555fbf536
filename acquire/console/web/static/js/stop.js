/** Stop button: always enabled, asks nothing, and states loudly if the stop was not confirmed. */

import { confirm } from "./dialogs.js";
import { byId, setDisabled, setText, show } from "./dom.js";
import { isRunning } from "./follow.js";
import { fixed, isNumber, sentence } from "./format.js";
import { postStop } from "./orders.js";

const NOT_CONFIRMED = "STOP NOT CONFIRMED";
const USE_SWITCH = "The console did not answer. Cut the striker's power at its switch or plug now.";

const HOMING = {
  word: "HOMING",
  text: "The arm moves to its start position. Keep clear.",
  timeout_ms: 60000,
};
/** What happened to the strike, by the state in which the stop found the striker. */
const FOUND = {
  armed: " It had not struck.",
  cocking: " It had not struck.",
  settled: " It had not struck.",
  released: " It was striking: the object may have been hit.",
  contact: " The object had been hit.",
  catch: " The strike was over.",
  verify: " The strike was over.",
};

let pending = 0;
let failed = false;
let redraw = () => {};

/** Send the stop. */
export async function stop() {
  pending += 1;
  redraw();
  try {
    await postStop();
    failed = false;
  } catch {
    failed = true;
  } finally {
    pending -= 1;
    redraw();
  }
}

/** Connect the stop button; `changed` redraws the page, `order` sends an order and reports its refusal. */
export function connectStop(changed, order) {
  redraw = changed;
  // `pointerdown`, not `click`: the stop acts when the finger lands.
  byId("stop").addEventListener("pointerdown", (event) => {
    if (event.button === 0) stop();
  });
  byId("stop").addEventListener("click", (event) => {
    if (event.detail === 0) stop();
  });
  byId("home").addEventListener("click", () =>
    confirm(
      "Home the striker again?",
      "The motor gets torque and the arm moves. Hands, cables and the object must be out of its way.",
      "Home the striker",
      () => order("/api/stop/clear", { confirm: true }, HOMING),
    ),
  );
}

/** Draw a fault of the striker outside a session; true if there is one. */
function drawFault(snapshot) {
  const fault = snapshot?.striker?.state === "fault" && !isRunning(snapshot.session);
  if (!fault) return false;
  setText(byId("stopped-title"), "STRIKER FAULT");
  setText(byId("stopped-text"), sentence(snapshot.striker.text));
  return true;
}

/**
 * Draw the stop's state; returns true while the striker counts as stopped or the stop failed.
 *
 * `moves`: an order of this page moves the arm now.
 */
export function drawStop(snapshot, mayOrder, moves) {
  const stopped = snapshot?.stop?.stopped === true && !moves;
  if (stopped) failed = false;
  setText(byId("stop-label"), pending > 0 ? "STOPPING" : "STOP");
  setText(byId("stop-keys"), stopped ? "stopped" : "Esc or Space");
  byId("stop").classList.toggle("done", stopped);
  const fault = !stopped && !failed && !moves && drawFault(snapshot);
  show(byId("stopped"), stopped || failed || fault);
  show(byId("home"), stopped || fault);
  setDisabled(byId("home"), !mayOrder, "Only the operator may home the striker.");
  byId("stopped").classList.toggle("alarm", failed);
  show(byId("stopped-switch"), stopped);
  if (failed) {
    setText(byId("stopped-title"), NOT_CONFIRMED);
    setText(byId("stopped-text"), USE_SWITCH);
  } else if (stopped) {
    const latency = snapshot.stop.latency_ms;
    const time = isNumber(latency) ? ` The striker took it ${fixed(latency, 0)} ms after the press.` : "";
    setText(byId("stopped-title"), "STOPPED");
    setText(byId("stopped-text"), sentence(snapshot.stop.text) + time + (FOUND[snapshot.stop.was] ?? ""));
  }
  return stopped || failed;
}
