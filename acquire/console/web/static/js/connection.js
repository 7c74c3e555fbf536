/**
 * Stream of snapshots from /api/events.
 *
 * It is read with `fetch`, not EventSource: comment lines, which the console sends every second, count as
 * signs of life here, so that a connection that died in silence is noticed within `SILENCE_MS`.
 */

const SILENCE_MS = 3500;
const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 3000;

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Split a text stream into events; returns [events, rest that is not complete yet]. */
export function splitEvents(text) {
  const blocks = text.replaceAll("\r\n", "\n").split("\n\n");
  const rest = blocks.pop();
  const events = [];
  for (const block of blocks) {
    const data = [];
    let name = "message";
    for (const line of block.split("\n")) {
      if (line.startsWith("data:")) data.push(line.slice(5).trimStart());
      if (line.startsWith("event:")) name = line.slice(6).trim();
    }
    if (data.length > 0) events.push({ name, data: data.join("\n") });
  }
  return [events, rest];
}

export class Connection {
  /**
   * `onState(snapshot)` is called with every snapshot, `onLink(state)` with "open", "lost" or "refused" when
   * the connection changes.
   */
  constructor(onState, onLink) {
    this.onState = onState;
    this.onLink = onLink;
    this.link = "";
  }

  /** Connect, and reconnect for as long as the page exists. */
  async run() {
    let delay_ms = FIRST_RETRY_MS;
    for (;;) {
      const began_ms = Date.now();
      const refused = await this.#stream().catch(() => false);
      this.#setLink(refused ? "refused" : "lost");
      delay_ms = Date.now() - began_ms > 5000 ? FIRST_RETRY_MS : Math.min(LONGEST_RETRY_MS, delay_ms * 1.5);
      await pause(refused ? LONGEST_RETRY_MS : delay_ms);
    }
  }

  #setLink(link) {
    if (link !== this.link) this.onLink(link);
    this.link = link;
  }

  /** Read one stream to its end; returns true if the console refused this browser. */
  async #stream() {
    const abort = new AbortController();
    let watchdog = setTimeout(() => abort.abort(), SILENCE_MS);
    try {
      const response = await fetch("/api/events", {
        headers: { Accept: "text/event-stream" },
        credentials: "same-origin",
        cache: "no-store",
        signal: abort.signal,
      });
      if (response.status === 401 || response.status === 403) return true;
      if (!response.ok) return false;
      const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return false;
        clearTimeout(watchdog);
        watchdog = setTimeout(() => abort.abort(), SILENCE_MS);
        const [events, rest] = splitEvents(text + value);
        text = rest;
        this.#setLink("open");
        const newest = events.filter((event) => event.name === "state").at(-1);
        if (newest) this.onState(JSON.parse(newest.data));
      }
    } finally {
      clearTimeout(watchdog);
      abort.abort();
    }
  }
}
