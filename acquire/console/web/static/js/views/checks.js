/** Lines of a check: outcome, name, finding, remedy. */

import { make } from "../dom.js";

const WORDS = { pass: "pass", warn: "warning", fail: "fail", skip: "not checked" };
const QUIET = ["pass", "skip"];

/** Lines that need attention, failures first. */
export const urgent = (lines) =>
  lines
    .filter((line) => !QUIET.includes(line.outcome))
    .sort((a, b) => (a.outcome === "fail" ? 0 : 1) - (b.outcome === "fail" ? 0 : 1));

/** Lines that passed or were skipped. */
export const quiet = (lines) => lines.filter((line) => QUIET.includes(line.outcome));

/** List items of the lines; each line is {name, outcome, text, remedy}. */
export function checkItems(lines) {
  return lines.map((line) =>
    make(
      "li",
      { class: line.outcome },
      make("span", { class: `tag ${line.outcome}` }, WORDS[line.outcome] ?? String(line.outcome)),
      make("span", { class: "name" }, line.name),
      make("span", { class: "found" }, line.text),
      line.remedy ? make("span", { class: "remedy" }, line.remedy) : null,
    ),
  );
}

/** Summary of the outcomes, "11 passed, 1 failed". */
export function summary(lines) {
  const words = { fail: "failed", warn: "with a warning", pass: "passed", skip: "not checked" };
  return Object.entries(words)
    .map(([outcome, word]) => [lines.filter((line) => line.outcome === outcome).length, word])
    .filter(([count]) => count > 0)
    .map(([count, word]) => `${count} ${word}`)
    .join(", ");
}
