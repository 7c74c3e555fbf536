/** Histogram of the live image's grey levels, as an aid for exposure. */

import { svg } from "./dom.js";

const BINS = 64;
const SAMPLE_WIDTH = 160;
const HEIGHT = 60;
/** Grey levels (of 255) that white paper should have. */
export const PAPER_LEVELS = [150, 220];

const canvas = document.createElement("canvas");

/** Share of the pixels in each of 64 bins of grey levels in the present image; null without an image. */
export function greyLevels(image) {
  if (!image.naturalWidth) return null;
  canvas.width = SAMPLE_WIDTH;
  canvas.height = Math.max(1, Math.round((SAMPLE_WIDTH * image.naturalHeight) / image.naturalWidth));
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
  const counts = new Array(BINS).fill(0);
  for (let i = 0; i < pixels.length; i += 4) {
    const grey = 0.299 * pixels[i] + 0.587 * pixels[i + 1] + 0.114 * pixels[i + 2];
    counts[Math.min(BINS - 1, Math.floor((grey * BINS) / 256))] += 1;
  }
  return counts.map((count) => (4 * count) / pixels.length);
}

/** Grey level (of 255) below which the given share of the pixels lies. */
export function quantile(shares, share) {
  let sum = 0;
  for (let bin = 0; bin < shares.length; bin += 1) {
    sum += shares[bin];
    if (sum >= share) return Math.round(((bin + 0.5) * 256) / shares.length);
  }
  return 255;
}

/** Draw the histogram (square root of the shares) with the band for white paper into an SVG of 256 x 60. */
export function drawHistogram(plot, shares) {
  const most = Math.max(...shares.slice(0, -1), 1e-6);
  const width = 256 / shares.length;
  const bars = shares.map((share, bin) => {
    const height = HEIGHT * Math.min(1, Math.sqrt(share / most));
    const last = bin === shares.length - 1;
    const at = { x: bin * width, y: HEIGHT - height, width: width - 0.6, height };
    return svg("rect", { ...at, class: last ? "bar saturated" : "bar" });
  });
  const [low, high] = PAPER_LEVELS;
  plot.replaceChildren(
    svg("rect", { x: low, y: 0, width: high - low, height: HEIGHT, class: "band" }),
    ...bars,
  );
}
