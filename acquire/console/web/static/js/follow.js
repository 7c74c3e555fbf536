/** View, sign and alarm that belong to a snapshot. Pure functions without access to the page. */

import { isNumber } from "./format.js";

export const VIEWS = ["ready", "place", "strike", "know", "archive"];

/** Texts of the verdicts. */
const VERDICTS = {
  good: "good",
  rocked_back: "rocked back",
  slid: "slid",
  rolled: "rolled",
  twisted: "twisted",
  airborne: "airborne",
  struck_twice: "struck twice",
  marker_lost: "tag lost",
  not_moved: "not moved",
  wrong_placement: "wrong placement",
  wrong_edge: "wrong edge",
  excluded: "excluded",
  unreadable: "images unreadable",
};

/** Verdict in words; a verdict that is not listed, with spaces for its underscores. */
export const verdictText = (verdict) => VERDICTS[verdict] ?? String(verdict ?? "").replaceAll("_", " ");

/** True if the estimate can use the strike. */
export const isUseful = (strike) => strike.used === true;

/** States of the striker in words. */
const STRIKER_STATES = {
  disarmed: "not armed",
  homed: "at its start position",
  armed: "armed",
  cocking: "armed, drawing back",
  settled: "armed, drawn back",
  released: "striking",
  contact: "striking",
  catch: "braking",
  verify: "braking",
  miss: "missed",
  fault: "in a fault",
};

/** State of the striker in words; a state that is not listed, as it is. */
export const strikerText = (state) => STRIKER_STATES[state] ?? state;

/** True if the session runs or is paused. */
export const isRunning = (session) => Boolean(session) && !["finished", "aborted"].includes(session.state);

/** True if the strike rocked back in a session that stops itself: it counts and is not repeated. */
export const countsAllTheSame = (strike, session) =>
  strike.verdict === "rocked_back" && strike.used && Boolean(session?.until);

/** Newest strike with a verdict, or null. */
export function newestStrike(snapshot) {
  const judged = (snapshot.session?.strikes ?? []).filter((strike) => strike.verdict);
  return judged.at(-1) ?? null;
}

/** Remark on a strike that rocked back in a session that stops itself. */
export const COUNTS_TEXT = "It rocked back before balance; its motion tells all the same";

/** View in which the session's present step is operated. */
export function viewFor(snapshot, verdictIsNew) {
  const session = snapshot.session;
  if (!session) return "ready";
  if (session.state === "finished" || session.state === "aborted") return "know";
  if (verdictIsNew) return "strike";
  if (snapshot.prompt || ["idle", "placing", "checking_pose", "tossing"].includes(session.state)) return "place";
  return "strike";
}

function placeSign(prompt) {
  if (prompt.kind === "toss")
    return prompt.hint?.startsWith("again: ")
      ? { word: "AGAIN", tone: "bad", text: "Hold it as on the card, then press Ready to toss." }
      : { word: "TOSS", tone: "accent", text: "Hold it as on the card, then press Ready to toss." };
  if (prompt.kind !== "place") return { word: "YOUR TURN", tone: "accent", text: prompt.text };
  if (prompt.hands_off === false && prompt.in_place === true)
    return { word: "HANDS OFF", tone: "wait", text: "The object is in place. Take your hands off it." };
  if (prompt.in_place === true) return { word: "IN PLACE", tone: "good", text: "Press Placed to go on." };
  return { word: "PLACE", tone: "accent", text: prompt.text };
}

/** States of the striker from the swing to its end. */
const SWINGING = ["released", "contact", "catch", "verify", "miss"];

function armedSign(armed) {
  if (isNumber(armed?.countdown_s)) {
    const seconds = Math.ceil(armed.countdown_s);
    return { word: seconds > 0 ? `ARMING ${seconds}` : "ARMING", tone: "armed", text: "The striker strikes after that. Step back." };
  }
  return { word: "ARMED", tone: "armed", text: "The striker is about to strike. Keep clear." };
}

/**
 * Sign for the operator, readable from two metres: a word, its tone and one line of text.
 *
 * The newest verdict is shown while `verdictIsNew`, unless the striker is armed.
 */
export function signFor(snapshot, verdictIsNew) {
  const { session, prompt, armed, stop } = snapshot;
  if (stop?.stopped) return { word: "STOPPED", tone: "stop", text: "Arm braked and held by software." };
  if (SWINGING.includes(snapshot.striker?.state))
    return { word: "STRIKING", tone: "armed", text: "The arm swings and goes back. Keep clear." };
  if (armed || session?.state === "striking") return armedSign(armed);
  if (!session) return { word: "NO SESSION", tone: "idle", text: "Start one in Ready." };
  if (session.paused && prompt)
    return { word: "PAUSED", tone: "wait", text: `${session.paused}. Press Resume to go on.` };
  if (session.state === "paused") return { word: "PAUSED", tone: "wait", text: session.paused ?? "" };
  if (session.state === "finished") return { word: "DONE", tone: "good", text: session.text };
  if (session.state === "aborted") return { word: "ENDED", tone: "bad", text: session.text };
  const newest = newestStrike(snapshot);
  if (verdictIsNew && newest) {
    if (newest.verdict === "good") return { word: "GOOD", tone: "good", text: newest.edge };
    if (countsAllTheSame(newest, session)) return { word: "COUNTS", tone: "good", text: COUNTS_TEXT };
    return { word: "AGAIN", tone: "bad", text: newest.reason || verdictText(newest.verdict) };
  }
  if (prompt) return placeSign(prompt);
  const waits = {
    idle:
      snapshot.striker?.state === "homed"
        ? ["WAIT", "idle", "The first strike is being chosen."]
        : ["STARTING", "armed", "The arm moves to its start position. Keep clear."],
    placing: ["WAIT", "idle", "The next placement follows."],
    checking_pose: ["HANDS OFF", "wait", "Checking the placement."],
    arming: ["ARMING", "armed", "The striker strikes after that. Step back."],
    recording: ["HANDS OFF", "wait", "The camera records until the object is at rest."],
    tossing: ["TOSS NOW", "good", "The camera records until the object lies still."],
    judging: ["HANDS OFF", "wait", session.strike_id ? "Judging the strike." : "Judging the toss."],
  };
  const [word, tone, text] = waits[session.state] ?? ["WAIT", "idle", session.text];
  return { word, tone, text };
}

/** Reason why a session may not be started, or "" if it may. */
export function startObstacle(snapshot) {
  if (!snapshot.daemon?.running) return "Start the rig first.";
  if (isRunning(snapshot.session)) return "A session is running.";
  if (snapshot.stop?.stopped) return "Home the striker first.";
  if (snapshot.check?.running) return "The check is running.";
  return "";
}

/** True if every check has passed, so that a session needs no override. */
export const isChecked = (snapshot) => snapshot.check?.passed === true;
