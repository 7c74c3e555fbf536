/** Roles: one operator gives orders, watchers see everything and may stop. */

import { confirm } from "./dialogs.js";
import { byId, setDisabled, setText, show } from "./dom.js";
import { counted } from "./format.js";

/** Connect the button that takes over. */
export function connectOperator(order) {
  byId("take").addEventListener("click", () =>
    confirm(
      "Take over as operator?",
      "The present operator can then only watch. Tell the person at the rig first.",
      "Take over",
      () => order("/api/operator/take"),
    ),
  );
}

/** Draw the role of this browser. */
export function drawOperator(snapshot, link) {
  const watching = snapshot?.role === "watcher";
  show(byId("watching"), watching && link === "open");
  if (watching) {
    const other = snapshot.operator_present
      ? "Another browser operates the rig."
      : "The operator's browser is not connected: the session pauses before its next strike.";
    setText(byId("watching-text"), `You are watching. ${other} You can stop the striker at any time.`);
    setDisabled(byId("take"), link !== "open");
  }
  const others = snapshot?.watchers ?? 0;
  const role = watching ? "Watching" : others > 0 ? `Operator, ${counted(others, "watcher")}` : "Operator";
  show(byId("role"), Boolean(snapshot));
  byId("role").classList.toggle("plain", !watching);
  setText(byId("role"), role);
}
