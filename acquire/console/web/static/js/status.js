/** Status bar beside the stop button: frames, losses, disk, progress. */

import { make, rebuild } from "./dom.js";
import { bytes, fixed, isNumber, minutes } from "./format.js";
import { isRunning, strikerText } from "./follow.js";

/** Minutes of recording below which the disk is marked. */
const LITTLE_DISK_MIN = 10;

function entry(name, value, tone = "") {
  return make("div", { class: tone || null }, make("dt", {}, name), make("dd", {}, value));
}

/** Draw the status bar. */
export function drawStatus(node, snapshot, link) {
  const { camera, disk, session, striker } = snapshot ?? {};
  const shown = [
    ["Frames lost", camera ? lostText(camera) : "–", camera?.lost > 0 ? "bad" : ""],
    ["Camera", camera ? `${fixed(camera.fps, 0)} /s` : "none", camera ? "" : "bad"],
    [
      "Disk",
      diskText(disk),
      isNumber(disk?.minutes_left) && disk.minutes_left < LITTLE_DISK_MIN ? "bad" : "",
    ],
    ["Striker", striker ? strikerText(striker.state) : "none", striker?.torque ? "wait" : ""],
  ];
  if (link !== "open" && snapshot) shown.splice(1, 1);
  if (isRunning(session)) shown.unshift(["Strikes", `${session.done} of ${session.total}${session.earlier > 0 ? ` + ${session.earlier}` : ""}`, ""]);
  if (link !== "open") shown.unshift(["Link", "lost", "bad"]);
  rebuild(node, shown, () => shown.map((each) => entry(...each)));
}

/** Number of frames lost, with their share. */
function lostText({ lost, frames }) {
  const share = (100 * lost) / Math.max(1, frames + lost);
  return lost > 0 ? `${lost} (${share < 0.01 ? "< 0.01" : fixed(share, 2)} %)` : "0";
}

function diskText(disk) {
  if (!disk) return "–";
  return isNumber(disk.minutes_left) ? minutes(disk.minutes_left) : bytes(disk.free_bytes);
}
