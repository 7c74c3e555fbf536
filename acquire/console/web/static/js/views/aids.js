/** Aids for setting up the camera: exposure, sharpness, size of the tags. */

import { byId, make, rebuild, setText, show } from "../dom.js";
import { fixed, isNumber, percent } from "../format.js";
import { drawHistogram, greyLevels, quantile } from "../histogram.js";

const HISTOGRAM_MS = 500;
/** Largest share of saturated pixels, as in `acquire check`. */
const SATURATED_MAX = 0.02;
/** Sides of a tag [px]: needed, recommended, largest that leaves room to tip. */
const TAG_PX = { least: 30, good: 60, most: 140 };
/** Share of the best sharpness so far from which the focus counts as good. */
const SHARP_SHARE = 0.8;

let sharpest = 0;
let camera_serial = null;

/** Meter: a value on a scale from 0 to `top` with the target range marked. */
function meter(name, value, top, [from, to], good, note) {
  const range = make("i", { class: "range" });
  range.style.left = `${(100 * from) / top}%`;
  range.style.width = `${(100 * (to - from)) / top}%`;
  const mark = make("i", { class: "mark" });
  mark.style.left = `${Math.min(100, Math.max(0, (100 * value) / top))}%`;
  return [
    make(
      "p",
      { class: "aid-head" },
      make("span", {}, name),
      make("output", { class: good ? "good" : "bad" }, note.value),
    ),
    make("div", { class: "meter", "aria-hidden": "true" }, range, mark),
    make("p", { class: "scale muted" }, note.target),
  ];
}

function drawSharpness(value) {
  const node = byId("aid-sharpness");
  show(node, isNumber(value));
  if (!isNumber(value)) return;
  sharpest = Math.max(sharpest, value);
  const good = value >= SHARP_SHARE * sharpest;
  const note = {
    value: fixed(value, 0),
    target: `best so far ${fixed(sharpest, 0)}: turn the focus ring to the highest value`,
  };
  rebuild(node, [value, sharpest], () =>
    meter("Sharpness", value, sharpest * 1.1, [SHARP_SHARE * sharpest, sharpest * 1.1], good, note),
  );
}

function drawTagSize(value) {
  const node = byId("aid-tag");
  show(node, true);
  if (!isNumber(value)) {
    rebuild(node, null, () => [
      make(
        "p",
        { class: "aid-head" },
        make("span", {}, "Tag size"),
        make("output", { class: "muted" }, "no tag in view"),
      ),
    ]);
    return;
  }
  const good = value >= TAG_PX.good;
  const target = `at least ${TAG_PX.least} px, better ${TAG_PX.good} px or more`;
  rebuild(node, value, () =>
    meter("Tag size", value, TAG_PX.most, [TAG_PX.good, TAG_PX.most], good, {
      value: `${fixed(value, 0)} px`,
      target,
    }),
  );
}

/** Draw the aids from the snapshot. */
export function drawAids(camera) {
  show(byId("aids"), Boolean(camera));
  if (!camera) return;
  if (camera.serial !== camera_serial) {
    camera_serial = camera.serial;
    sharpest = 0;
  }
  drawSharpness(camera.sharpness);
  drawTagSize(camera.tag_px);
}

/** Draw the histogram twice a second while the live image is shown; `latest` returns the snapshot. */
export function connectHistogram(preview, latest) {
  setInterval(() => {
    if (!preview.live || document.hidden) return;
    const shares = greyLevels(preview.image);
    if (!shares) return;
    drawHistogram(byId("histogram"), shares);
    const saturated = latest()?.camera?.saturated_fraction;
    const good = isNumber(saturated) && saturated <= SATURATED_MAX;
    const text = isNumber(saturated) ? `${percent(saturated)} saturated` : "";
    setText(
      byId("exposure-value"),
      [text, `brightest 1 % at ${quantile(shares, 0.99)}`].filter(Boolean).join(", "),
    );
    byId("exposure-value").className = good || !isNumber(saturated) ? "good" : "bad";
  }, HISTOGRAM_MS);
}
