/** Short tones for the signs, as an aid for an operator who does not look at the page. */

const KEY = "percuss-sound";
const RISE_S = 0.01;

/** Tones of each sign: frequency [Hz] and duration [s], in order. */
const TONES = {
  PLACE: [
    [660, 0.12],
    [660, 0.12],
  ],
  "HANDS OFF": [[440, 0.35]],
  ARMED: [
    [880, 0.08],
    [880, 0.08],
    [880, 0.08],
  ],
  GOOD: [
    [523, 0.1],
    [659, 0.1],
    [784, 0.2],
  ],
  AGAIN: [
    [392, 0.18],
    [294, 0.3],
  ],
  STOPPED: [[220, 0.5]],
  "CONNECTION LOST": [
    [330, 0.2],
    [247, 0.2],
    [330, 0.2],
    [247, 0.2],
  ],
};

let context = null;
let enabled = read();

function read() {
  try {
    return localStorage.getItem(KEY) !== "off";
  } catch {
    return true;
  }
}

/** True if tones are played. */
export const isSoundOn = () => enabled;

/** Switch the tones on or off; the choice is kept in this browser. */
export function setSound(on) {
  enabled = on;
  try {
    localStorage.setItem(KEY, on ? "on" : "off");
  } catch {
    // A browser without storage forgets the choice.
  }
  if (on) beep("GOOD");
}

/** Browsers start audio only after the user has touched the page. */
export function unlockSound() {
  context ??= new AudioContext();
  if (context.state === "suspended") context.resume();
}

/** Play the tones of a sign; nothing if it has none or sound is off. */
export function beep(word) {
  const tones = TONES[word];
  if (!enabled || !tones || !context || context.state !== "running") return;
  let start = context.currentTime + 0.02;
  for (const [frequency, duration] of tones) {
    const oscillator = new OscillatorNode(context, { frequency });
    const gain = new GainNode(context, { gain: 0 });
    gain.gain.setValueAtTime(0, start);
    gain.gain.linearRampToValueAtTime(0.25, start + RISE_S);
    gain.gain.setValueAtTime(0.25, start + duration - RISE_S);
    gain.gain.linearRampToValueAtTime(0, start + duration);
    oscillator.connect(gain).connect(context.destination);
    oscillator.start(start);
    oscillator.stop(start + duration);
    start += duration + 0.07;
  }
}
