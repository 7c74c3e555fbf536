/** View Place: placement card beside the live image with the wanted outline, and the measured offset. */

import { byId, make, rebuild, setAttribute, setDisabled, setText, show, svg } from "../dom.js";
import { confirm } from "../dialogs.js";
import { AXIS_NAMES } from "../ellipse.js";
import { isRunning } from "../follow.js";
import { isNumber, sentence, signed } from "../format.js";
import { Preview } from "../preview.js";

/** Offsets below which a value is green while the session does not report whether the object is in place. */
const TOLERANCE_MM = 3.0;
const TOLERANCE_DEG = 2.0;
/** Cards are drawn when a session starts; until then they are asked for again after this time [ms]. */
const CARD_RETRY_MS = 1500;

let page;
let preview;
/** Newest prompt of the session: its card stays in sight until the strike. */
let newest = null;

/** Connect the view's controls. */
export function connect(context) {
  page = context;
  preview = new Preview(byId("place-image"), byId("place-frame"), byId("place-absent"));
  byId("place-skip").addEventListener("click", skip);
  byId("place-pause").addEventListener("click", () => pauseOrResume("now"));
  byId("card").addEventListener("error", () => {
    setTimeout(() => {
      setAttribute(byId("card"), "src", null);
      page.redraw();
    }, CARD_RETRY_MS);
  });
}

/** Answer the open prompt; nothing without one. */
export function answer(order) {
  const prompt = page.latest()?.prompt;
  if (prompt) return page.order("/api/prompt/answer", { id: prompt.id, ok: true, order });
  return Promise.resolve(null);
}

/** Leave the strike out, after a question. */
export function skip() {
  const id = page.latest()?.prompt?.id;
  confirm(
    "Leave this strike out?",
    "The session goes on with another one, and does not come back to it.",
    "Leave it out",
    () => page.latest()?.prompt?.id === id && answer("skip"),
  );
}

/** Pause the session, or let it go on if a pause is requested or in force. */
export function pauseOrResume(when) {
  if (page.latest()?.session?.paused) return page.order("/api/session/resume");
  return page.order("/api/session/pause", { when });
}

/** Main action of the view: Placed, or Resume while the session is paused. */
export function action(snapshot) {
  const { session, prompt } = snapshot;
  if (session?.paused)
    return { label: "Resume", problem: "", run: () => page.order("/api/session/resume") };
  if (session && !isRunning(session)) return { label: "Show the answer", problem: "", run: page.follow };
  const labels = { place: "Placed", toss: "Ready to toss" };
  const label = prompt ? (labels[prompt.kind] ?? "Done") : "Placed";
  return { label, problem: prompt ? "" : "Nothing is to be placed now.", run: () => answer("placed") };
}

/** Axes x, y, z of the object where it stands, with their names beyond their ends. */
function axisLines(axes_px) {
  const [origin, ...ends] = axes_px;
  return ends.flatMap((end, i) => {
    const d = `M${origin.join(",")}L${end.join(",")}`;
    const [u, v] = [0, 1].map((each) => end[each] + 0.14 * (end[each] - origin[each]));
    return [
      svg("path", { class: "halo", d }),
      svg("path", { class: "axis", d }),
      svg("text", { x: u, y: v, "text-anchor": "middle", dy: "0.35em" }, AXIS_NAMES[i]),
    ];
  });
}

function drawOutline(prompt, camera) {
  const plot = byId("outline");
  const known = Boolean(prompt?.outline_px && camera);
  show(plot, known);
  if (!known) return;
  setAttribute(plot, "viewBox", `0 0 ${camera.width} ${camera.height}`);
  plot.setAttribute("class", prompt.in_place === true ? "in-place" : "");
  rebuild(plot, [prompt.outline_px, prompt.axes_px, camera.width], () => {
    const points = prompt.outline_px.map(([u, v]) => `${u},${v}`).join(" ");
    return [
      svg("polygon", { class: "halo", points }),
      svg("polygon", { class: "line", points }),
      ...(prompt.axes_px ? axisLines(prompt.axes_px) : []),
    ];
  });
}

function offset(name, value, unit, good) {
  const tone = isNumber(value) ? (good ? "good" : "off") : "unknown";
  const shown = isNumber(value) ? `${signed(value, 1)} ` : "– ";
  return make("div", { class: tone }, make("dt", {}, name), make("dd", {}, shown, make("small", {}, unit)));
}

function drawOffsets(prompt) {
  const [dx, dy] = prompt.offset_mm ?? [null, null];
  const within = (value, tolerance) =>
    prompt.in_place === true || (isNumber(value) && Math.abs(value) <= tolerance);
  rebuild(byId("offsets"), [prompt.offset_mm, prompt.angle_deg, prompt.in_place], () => [
    offset("Offset x", dx, "mm", within(dx, TOLERANCE_MM)),
    offset("Offset y", dy, "mm", within(dy, TOLERANCE_MM)),
    offset("Turn", prompt.angle_deg, "deg", within(prompt.angle_deg, TOLERANCE_DEG)),
  ]);
}

/** Prompt to show: the open one, or while the placement is checked the last one without its values. */
function shownPrompt(snapshot) {
  const { prompt, session } = snapshot;
  if (prompt) newest = { ...prompt, session_id: session?.id };
  if (prompt) return prompt;
  if (!isRunning(session) || newest?.session_id !== session.id) return null;
  const unknown = { offset_mm: null, angle_deg: null, in_place: null, hands_off: false, axes_px: null };
  return { ...newest, ...unknown, hint: "", text: "" };
}

const STATES = [
  [(prompt) => prompt.in_place === true && prompt.hands_off, "in place, hands off"],
  [(prompt) => prompt.in_place === true, "in place, hands still in view"],
  [(prompt) => prompt.in_place === false, "not in place yet"],
  [() => true, "placement not measured"],
];

/** Draw the view. */
export function draw(snapshot, mayOrder) {
  const { session, camera } = snapshot;
  const asked = Boolean(snapshot.prompt);
  const prompt = shownPrompt(snapshot);
  const running = isRunning(session);
  show(byId("place-grid"), Boolean(prompt) || running);
  show(byId("place-none"), !prompt && !running);
  setText(byId("place-none"), "No session asks for a placement.");
  setText(byId("place-text"), sentence(prompt?.hint || prompt?.text));
  setDisabled(byId("place-skip"), !mayOrder || !asked);
  setDisabled(byId("place-pause"), !mayOrder || !isRunning(session));
  setText(byId("place-pause"), session?.paused ? "Resume" : "Pause the session");
  setText(
    byId("place-absent"),
    camera ? "The live image does not arrive." : "No camera: place the object by the card.",
  );
  drawOutline(prompt, camera);
  setText(byId("place-state"), asked ? STATES.find(([holds]) => holds(prompt))[1] : "");
  show(byId("offsets"), Boolean(prompt));
  show(byId("card-panel"), Boolean(prompt));
  if (!prompt) return;
  drawOffsets(prompt);
  setText(byId("card-strike"), [prompt.strike_id, prompt.edge].filter(Boolean).join(" · "));
  const card = prompt.card.startsWith("/api/") ? prompt.card : null;
  if (byId("card").getAttribute("src") !== card) setAttribute(byId("card"), "src", card);
  show(byId("card-open"), card !== null);
  show(byId("card-none"), card === null);
}

/** Load the live image while the view is shown. */
export const setVisible = (visible, snapshot) =>
  preview.set(visible && isRunning(snapshot.session), snapshot.camera);
