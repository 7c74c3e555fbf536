/** Keys of the whole page: stop, main action, views. A foot pedal sends the same keys. */

import { closeDialogs, isDialogOpen, toggleHelp } from "./dialogs.js";
import { takesText } from "./dom.js";
import { VIEWS } from "./follow.js";
import { unlockSound } from "./sound.js";
import { stop } from "./stop.js";

/** Time in which a second Enter is ignored [ms], so that one press of a pedal is one action. */
const ENTER_PAUSE_MS = 700;

let entered_ms = -ENTER_PAUSE_MS;

function stopKey(event) {
  event.preventDefault();
  event.stopPropagation();
  closeDialogs();
  if (!event.repeat) stop();
}

/** True if Enter belongs to the focused control itself. */
const hasOwnEnter = (node) => Boolean(node?.closest?.("button, a[href], select, summary"));

function enterKey(event, act) {
  if (isDialogOpen() || hasOwnEnter(document.activeElement)) {
    if (event.repeat) event.preventDefault();
    return;
  }
  event.preventDefault();
  const now_ms = performance.now();
  if (event.repeat || now_ms - entered_ms < ENTER_PAUSE_MS) return;
  entered_ms = now_ms;
  act();
}

/** Connect the keys; `page` has `act`, `follow`, `toggleLarge`, `toggleSound` and `goTo`. */
export function connectKeys(page) {
  const letters = {
    f: page.follow,
    l: page.toggleLarge,
    s: page.toggleSound,
    "?": toggleHelp,
  };
  document.addEventListener(
    "keydown",
    (event) => {
      unlockSound();
      const typing = takesText(document.activeElement);
      if (event.key === "Escape" || (event.key === " " && !typing)) return stopKey(event);
      if (event.ctrlKey || event.metaKey || event.altKey) return undefined;
      if (event.key === "Enter") return enterKey(event, page.act);
      if (typing || event.repeat) return undefined;
      if (isDialogOpen()) return event.key === "?" ? toggleHelp() : undefined;
      const number = Number(event.key);
      if (number >= 1 && number <= VIEWS.length) return page.goTo(VIEWS[number - 1]);
      return letters[event.key.toLowerCase()]?.();
    },
    { capture: true },
  );
  // Firefox activates a focused button when Space is released.
  document.addEventListener(
    "keyup",
    (event) => {
      if (event.key === " " && !takesText(document.activeElement)) event.preventDefault();
    },
    { capture: true },
  );
  // After a click the focus leaves the button: a pedal's Enter must mean the main action, not the click again.
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("button");
    if (button && event.detail > 0 && !button.closest("dialog")) button.blur();
  });
  document.addEventListener("pointerdown", unlockSound, { capture: true });
}
