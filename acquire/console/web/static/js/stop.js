/** Stop button: always enabled, asks nothing, and states loudly if the stop was not confirmed. */

import { confirm } from "./dialogs.js";
import { byId, setDisabled, setText, show } from "./dom.js";
import { fixed, isNumber, sentence } from "./format.js";
import { postStop } from "./orders.js";

const NOT_CONFIRMED = "STOP NOT CONFIRMED";
const USE_SWITCH = "The console did not answer. Cut the striker's power at its switch or plug now.";

const HOMING = { doing: "The arm moves to its start position. Keep clear.", timeout_ms: 40000 };

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

/** Draw the stop's state; returns true while the striker counts as stopped or the stop failed. */
export function drawStop(snapshot, mayOrder) {
  const stopped = snapshot?.stop?.stopped === true;
  if (stopped) failed = false;
  setText(byId("stop-label"), pending > 0 ? "STOPPING" : "STOP");
  setText(byId("stop-keys"), stopped ? "stopped" : "Esc or Space");
  byId("stop").classList.toggle("done", stopped);
  show(byId("stopped"), stopped || failed);
  show(byId("home"), stopped);
  setDisabled(byId("home"), !mayOrder, "Only the operator may home the striker.");
  byId("stopped").classList.toggle("alarm", failed);
  show(byId("stopped-switch"), !failed);
  if (failed) {
    setText(byId("stopped-title"), NOT_CONFIRMED);
    setText(byId("stopped-text"), USE_SWITCH);
  } else if (stopped) {
    const latency = snapshot.stop.latency_ms;
    const time = isNumber(latency) ? ` The striker took it ${fixed(latency, 0)} ms after the press.` : "";
    setText(byId("stopped-title"), "STOPPED");
    setText(byId("stopped-text"), sentence(snapshot.stop.text) + time);
  }
  return stopped || failed;
}
