/**
 * Dialogs: confirmation, help, and the enlarged placement card.
 *
 * They are not modal, because a modal dialog would make the stop button inert: everything but the bar with
 * the stop button is made inert here instead.
 */

import { byId, setAttribute, setText, show } from "./dom.js";

const COVERED = [".top", "#banners", "#sign", "main"];

let confirmed = null;
let opener = null;
let changed = () => {};

/** True while any dialog is open. */
export const isDialogOpen = () => document.querySelector("dialog[open]") !== null;

function cover(covered) {
  for (const selector of COVERED) document.querySelector(selector).inert = covered;
  show(byId("veil"), covered);
  changed();
}

function open(dialog, focused) {
  if (isDialogOpen()) return;
  opener = document.activeElement;
  dialog.show();
  cover(true);
  focused.focus();
}

/** Close all dialogs; focus returns to where it was. */
export function closeDialogs() {
  if (!isDialogOpen()) return;
  for (const dialog of document.querySelectorAll("dialog[open]")) dialog.close();
  cover(false);
  opener?.focus({ preventScroll: true });
}

/**
 * Ask for a confirmation; `run` is called if the operator agrees. Focus begins on Cancel, so that Enter of a
 * foot pedal confirms nothing.
 */
export function confirm(title, text, label, run) {
  setText(byId("confirm-title"), title);
  setText(byId("confirm-text"), text);
  setText(byId("confirm-yes"), label);
  confirmed = run;
  open(byId("confirm"), byId("confirm-no"));
}

/** Open the help, or close it. */
export function toggleHelp() {
  if (byId("help").open) closeDialogs();
  else open(byId("help"), byId("help-title"));
}

/** Connect the buttons of all dialogs; `redraw` is called when one opens or closes. */
export function connectDialogs(redraw) {
  changed = redraw;
  for (const id of ["confirm-no", "help-close", "card-close"])
    byId(id).addEventListener("click", closeDialogs);
  byId("confirm-yes").addEventListener("click", () => {
    closeDialogs();
    const run = confirmed;
    confirmed = null;
    run?.();
  });
  byId("help-open").addEventListener("click", toggleHelp);
  byId("veil").addEventListener("click", closeDialogs);
  byId("card-open").addEventListener("click", () => {
    setAttribute(byId("card-large"), "src", byId("card").getAttribute("src"));
    open(byId("card-dialog"), byId("card-close"));
  });
}
