/** Numbers as text. Every function returns an en dash for a number that is not known. */

const UNKNOWN = "–";
const MINUS = "−";
const SUPERSCRIPTS = {
  "-": "⁻",
  0: "⁰",
  1: "¹",
  2: "²",
  3: "³",
  4: "⁴",
  5: "⁵",
  6: "⁶",
  7: "⁷",
  8: "⁸",
  9: "⁹",
};

/** Half width of a 95 % interval in standard deviations of a normal distribution. */
export const HALF_WIDTH_95 = 1.959964;

/** True if the value is a finite number. */
export const isNumber = (value) => typeof value === "number" && Number.isFinite(value);

/** Number with a fixed count of decimals and a typographic minus sign; never "−0.0". */
export function fixed(value, decimals = 1) {
  if (!isNumber(value)) return UNKNOWN;
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Number with a sign in front of positive values, too. */
export function signed(value, decimals = 1) {
  const text = fixed(value, decimals);
  return isNumber(value) && !text.startsWith(MINUS) && Number(text) !== 0 ? `+${text}` : text;
}

/** Decimals at which an uncertainty shows two significant digits; between 0 and `most`. */
export function decimalsFor(uncertainty, most = 3) {
  if (!isNumber(uncertainty) || uncertainty <= 0) return 1;
  return Math.min(most, Math.max(0, 1 - Math.floor(Math.log10(uncertainty))));
}

/** Length in millimetres with its unit, from metres. */
export function millimetres(value_m, decimals = 2) {
  return isNumber(value_m) ? `${fixed(value_m * 1e3, decimals)} mm` : UNKNOWN;
}

/** Power of ten, a multiple of 3 unless `any`, by which the largest of the values is between 1 and 1000. */
export function commonPower(values) {
  const largest = Math.max(...values.filter(isNumber).map(Math.abs), 0);
  return largest > 0 ? 3 * Math.floor(Math.log10(largest) / 3) : 0;
}

/** Power of ten in superscript digits, as in 10⁻³; "" for 10⁰. */
export function powerText(power) {
  return power === 0 ? "" : `10${[...String(power)].map((digit) => SUPERSCRIPTS[digit]).join("")}`;
}

/** Bytes in decimal units, "412 GB" for example. */
export function bytes(count) {
  if (!isNumber(count)) return UNKNOWN;
  const units = ["B", "kB", "MB", "GB", "TB"];
  const step = count > 0 ? Math.min(units.length - 1, Math.floor(Math.log10(count) / 3)) : 0;
  const value = count / 10 ** (3 * step);
  return `${value.toFixed(step > 0 && value < 10 ? 1 : 0)} ${units[step]}`;
}

/** Duration from minutes: "47 min", "3 h 20 min" or "> 48 h". */
export function minutes(value) {
  if (!isNumber(value)) return UNKNOWN;
  if (value > 48 * 60) return "> 48 h";
  const whole = Math.floor(value);
  return whole < 90 ? `${whole} min` : `${Math.floor(whole / 60)} h ${whole % 60} min`;
}

/** Percentage from a fraction. */
export function percent(fraction, decimals = 1) {
  return isNumber(fraction) ? `${fixed(fraction * 100, decimals)} %` : UNKNOWN;
}

/** Local date and time to the minute, "2026-11-29 14:05"; texts that are no date stay as they are. */
export function dateTime(text) {
  const date = new Date(text);
  if (Number.isNaN(date.getTime())) return String(text ?? UNKNOWN);
  const two = (number) => String(number).padStart(2, "0");
  return (
    `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())} ` +
    `${two(date.getHours())}:${two(date.getMinutes())}`
  );
}

/** Text as a sentence: a capital first, and an end. */
export function sentence(text) {
  const trimmed = String(text ?? "").trim();
  if (trimmed === "") return "";
  return trimmed[0].toUpperCase() + trimmed.slice(1) + (/[.!?…]$/.test(trimmed) ? "" : ".");
}

/** Count with its noun, "1 strike" or "3 strikes". */
export const counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
