/** Dialogs: confirmation, help, and the enlarged placement card. */

import { byId, setAttribute, setText } from "./dom.js";

let confirmed = null;

/**
 * Ask for a confirmation; `run` is called if the operator agrees. Focus begins on Cancel, so that Enter of a
 * foot pedal confirms nothing.
 */
export function confirm(title, text, label, run) {
  setText(byId("confirm-title"), title);
  setText(byId("confirm-text"), text);
  setText(byId("confirm-yes"), label);
  confirmed = run;
  if (!byId("confirm").open) byId("confirm").showModal();
  byId("confirm-no").focus();
}

/** True while any dialog is open. */
export const isDialogOpen = () => document.querySelector("dialog[open]") !== null;

/** Close all dialogs. */
export function closeDialogs() {
  for (const dialog of document.querySelectorAll("dialog[open]")) dialog.close();
}

/** Open the help, or close it. */
export function toggleHelp() {
  const help = byId("help");
  if (help.open) help.close();
  else if (!isDialogOpen()) help.showModal();
}

/** Connect the buttons of all dialogs. */
export function connectDialogs() {
  byId("confirm-no").addEventListener("click", () => byId("confirm").close());
  byId("confirm-yes").addEventListener("click", () => {
    byId("confirm").close();
    const run = confirmed;
    confirmed = null;
    run?.();
  });
  byId("help-open").addEventListener("click", toggleHelp);
  byId("help-close").addEventListener("click", () => byId("help").close());
  byId("card-close").addEventListener("click", () => byId("card-dialog").close());
  byId("card-open").addEventListener("click", () => {
    setAttribute(byId("card-large"), "src", byId("card").getAttribute("src"));
    byId("card-dialog").showModal();
  });
}
