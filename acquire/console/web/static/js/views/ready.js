/** View Ready: check, session form, camera with its aids, state of the rig. */

import { byId, make, rebuild, setDisabled, setText, show } from "../dom.js";
import { isChecked, isRunning, startObstacle, strikerText } from "../follow.js";
import { bytes, counted, dateTime, fixed, minutes, sentence } from "../format.js";
import { get } from "../orders.js";
import { Preview } from "../preview.js";
import { connectHistogram, drawAids } from "./aids.js";
import { checkItems, quiet, summary, urgent } from "./checks.js";

const LEAST_REASON = 3;
const RIG_STARTS = { text: "The rig starts: camera and striker are opened.", timeout_ms: 60000 };
const SESSION_STARTS = {
  word: "STARTING",
  text: "The arm moves to its start position. Keep clear.",
  timeout_ms: 90000,
};
/** Width of the window [px] from which the checks that passed are unfolded at first. */
const WIDE_PX = 700;

const NEW_SESSION = "nothing: a new session";
/** Time after which the recordings to go on with are loaded again while the view is shown [ms]. */
const EARLIER_MS = 5000;
/** Recordings that are offered to go on with, the newest first. */
const MAX_EARLIER = 8;

let page;
let preview;
let earlier = [];
let earlierFor = null;
let earlier_ms = 0;
/** Ended session that the form is to go on with, and the id of its recording; null if there is none. */
let offered = null;

/** Connect the view's controls; `context` has `order(path, content)`, `latest()` and `redraw()`. */
export function connect(context) {
  page = context;
  preview = new Preview(byId("ready-image"), byId("ready-frame"), byId("ready-absent"));
  connectHistogram(preview, page.latest);
  byId("check").addEventListener("click", () => page.order("/api/check"));
  byId("invite").addEventListener("click", invite);
  byId("object").addEventListener("change", page.redraw);
  byId("check-passed").open = innerWidth >= WIDE_PX;
  const form = byId("start-form");
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", page.redraw);
}

/** Fill in the form for a session that goes on with an ended one; `id` is its recording's. */
export function offer(session, id) {
  offered = { session, id };
  earlierFor = null;
  const form = byId("start-form").elements;
  form.end.value = session.until ? "until" : "plan";
  for (const name of ["com", "inertia"]) {
    const given = new RegExp(`${name}=([0-9.]+)`).exec(session.until);
    if (session.until) byId(`until-${name}`).value = given ? given[1] : "";
  }
  byId("name").value = "";
  page.redraw();
}

/** Choose the offered session's object, plan and recording, as soon as the lists hold them. */
function chooseOffered(choices) {
  if (!offered) return;
  const { session, id } = offered;
  const plan = choices.plans.find((each) => each.name.split("/").at(-1) === session.plan);
  if (plan) {
    byId("object").value = plan.object_id;
    options(byId("plan"), [[plan.id, ""]], "");
    byId("plan").value = plan.id;
  }
  if (!earlier.some((each) => each.id === id && each.complete)) return;
  options(byId("resume"), [["", ""], [id, ""]], "");
  byId("resume").value = id;
  offered = null;
}

const untilChosen = () => byId("start-form").elements.end.value === "until";
const reason = () => byId("override").value.trim();

/** Target in the form of `--until`: "com=0.5mm,inertia=2%"; "" if no target is given. */
function target() {
  const parts = [];
  if (byId("until-com").value) parts.push(`com=${byId("until-com").value}mm`);
  if (byId("until-inertia").value) parts.push(`inertia=${byId("until-inertia").value}%`);
  return parts.join(",");
}

function startProblem(snapshot) {
  const obstacle = startObstacle(snapshot);
  if (obstacle) return obstacle;
  if (!byId("object").value) return "Choose an object.";
  if (!byId("plan").value) return "Choose a plan. `analyze plan` makes one for the object.";
  if (!byId("start-form").checkValidity()) return "Correct the marked field.";
  if (untilChosen() && !target()) return "Give a target for the centre of mass or the inertia.";
  if (isChecked(snapshot) || reason().length >= LEAST_REASON) return "";
  return "The check has not passed: follow its remedies, or give a reason to start anyway.";
}

async function start(snapshot) {
  const content = { object_id: byId("object").value, plan_id: byId("plan").value };
  if (byId("resume").value) content.resume = [byId("resume").value];
  if (byId("countdown").value) content.countdown_s = Number(byId("countdown").value);
  if (byId("name").value.trim()) content.name = byId("name").value.trim();
  if (untilChosen()) {
    content.until = target();
    if (byId("max-strikes").value) content.max_strikes = Number(byId("max-strikes").value);
  }
  if (!isChecked(snapshot)) content.override = reason();
  if (!(await page.order("/api/session/start", content, SESSION_STARTS))) return;
  byId("override").value = "";
  byId("resume").value = "";
  page.follow();
}

/** Show an address with which one more browser can watch. */
async function invite() {
  const answer = await page.order("/api/invite");
  if (!answer?.url) return;
  byId("invitation").value = answer.url;
  show(byId("invitation-field"), true);
  byId("invitation").select();
}

/** Main action of the view: start the daemon, check, or start a session. */
export function action(snapshot) {
  if (!snapshot.daemon.running)
    return {
      label: "Start the rig",
      problem: "",
      run: () => page.order("/api/daemon/start", {}, RIG_STARTS),
    };
  if (snapshot.check.passed === null && !reason())
    return {
      label: "Check",
      problem: snapshot.check.running ? "The check is running." : "",
      run: () => page.order("/api/check"),
    };
  const label = isChecked(snapshot) ? "Start" : "Start anyway";
  return { label, problem: startProblem(snapshot), run: () => start(snapshot) };
}

function options(select, entries, placeholder) {
  const chosen = select.value;
  rebuild(select, entries, () =>
    entries.length > 0
      ? entries.map(([id, text]) => make("option", { value: id }, text))
      : [make("option", { value: "" }, placeholder)],
  );
  if (entries.some(([id]) => id === chosen)) select.value = chosen;
}

const strikesText = ({ strikes, earlier_strikes: earlier }) =>
  `${counted(strikes, "strike")}${earlier > 0 ? ` + ${earlier} earlier` : ""}`;

/** Load the recordings to go on with, as finished meanwhile as well. */
async function loadEarlier(key) {
  earlierFor = key;
  earlier_ms = Date.now();
  earlier = await get("/api/archive").catch(() => []);
  page.redraw();
}

function drawEarlier(snapshot) {
  const key = `${snapshot.session?.began_ns} ${isRunning(snapshot.session)}`;
  if (key !== earlierFor || Date.now() - earlier_ms > EARLIER_MS) loadEarlier(key);
  const name = snapshot.choices.objects.find((each) => each.id === byId("object").value)?.name;
  const fitting = earlier.filter((each) => each.complete && each.object === name).slice(0, MAX_EARLIER);
  const entries = fitting.map((each) => [
    each.id,
    `${each.file} (${strikesText(each)}, ${dateTime(each.date)})`,
  ]);
  options(byId("resume"), [["", NEW_SESSION], ...entries], NEW_SESSION);
}

function drawForm(snapshot, mayOrder) {
  const { objects, plans } = snapshot.choices;
  options(
    byId("object"),
    objects.map((each) => [each.id, each.name]),
    "no object file in the folder",
  );
  chooseOffered(snapshot.choices);
  const fitting = plans.filter((plan) => plan.object_id === byId("object").value);
  options(
    byId("plan"),
    fitting.map((each) => [each.id, `${each.name} (${counted(each.strikes, "strike")})`]),
    "no plan for this object",
  );
  drawEarlier(snapshot);
  show(byId("until-fields"), untilChosen());
  const running = isRunning(snapshot.session);
  show(byId("override-field"), snapshot.daemon.running && snapshot.check.passed === false && !running);
  for (const control of byId("start-form").elements)
    if (control.id !== "override") setDisabled(control, !mayOrder || running);
  setDisabled(byId("override"), !mayOrder);
  setText(byId("start-note"), mayOrder && snapshot.daemon.running ? startProblem(snapshot) : "");
}

function drawCheck(snapshot, mayOrder) {
  const { running, passed, lines } = snapshot.check;
  const state = running
    ? "checking…"
    : passed === null
      ? "not checked yet"
      : summary(urgent(lines)) || "nothing to mend";
  setText(byId("check-summary"), state);
  setText(byId("check"), passed === null ? "Check" : "Check again");
  setDisabled(byId("check"), !mayOrder || running || !snapshot.daemon.running);
  const [loud, silent] = [urgent(lines), quiet(lines)];
  rebuild(byId("check-lines"), loud, () => checkItems(loud));
  rebuild(byId("check-passed-lines"), silent, () => checkItems(silent));
  show(byId("check-lines"), loud.length > 0);
  show(byId("check-passed"), silent.length > 0);
  setText(byId("check-passed-count"), summary(silent));
}

function drawFacts(snapshot) {
  const { camera, striker, disk } = snapshot;
  const torque = striker?.torque === null || !striker ? "unknown" : striker.torque ? "on" : "off";
  const facts = [
    ["Striker", striker ? `${strikerText(striker.state)}${striker.text ? `: ${striker.text}` : ""}` : "not reported"],
    ["Torque", torque],
    ["Frame rate", camera ? `${fixed(camera.fps, 1)} /s` : "no camera"],
    ["Exposure", camera ? `${fixed(camera.exposure_us, 0)} µs` : "–"],
    ["Image", camera ? `${camera.width} × ${camera.height} px` : "–"],
    [
      "Frames lost",
      camera
        ? `${camera.lost} of ${camera.frames} since the rig started; the report names the strikes that lack images`
        : "–",
    ],
    ["Disk", disk ? `${bytes(disk.free_bytes)} free, ${minutes(disk.minutes_left)}` : "–"],
    ["Program", snapshot.daemon.text],
  ];
  rebuild(byId("rig-facts"), facts, () =>
    facts.map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))),
  );
}

/** Draw the view. */
export function draw(snapshot, mayOrder) {
  show(byId("no-daemon"), !snapshot.daemon.running);
  const ended = snapshot.daemon.text.includes("ended") ? snapshot.daemon.text : "";
  setText(byId("no-daemon-text"), sentence(ended));
  show(byId("no-daemon-text"), ended !== "");
  drawCheck(snapshot, mayOrder);
  drawForm(snapshot, mayOrder);
  const { camera } = snapshot;
  setText(byId("camera-model"), camera ? `${camera.model} (${camera.serial})` : "");
  setText(
    byId("ready-absent"),
    camera
      ? "The live image does not arrive."
      : snapshot.daemon.running
        ? "No camera. Check its cable and power, then press Check again."
        : "The live image follows when the rig runs.",
  );
  setDisabled(byId("invite"), !mayOrder, "Only the operator may let another browser in.");
  drawAids(camera);
  drawFacts(snapshot);
}

/** Load the live image while the view is shown. */
export const setVisible = (visible, snapshot) => preview.set(visible, snapshot.camera);
