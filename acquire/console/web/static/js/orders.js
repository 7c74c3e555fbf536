/** Orders to the console: POST with JSON, and the stop with its own rules. */

const STOP_ATTEMPTS = 3;
const STOP_TIMEOUT_MS = 1500;
const ORDER_TIMEOUT_MS = 15000;

/** Refusal of an order: message, remedy and HTTP status (0 if there was no answer). */
export class OrderError extends Error {
  constructor(message, remedy, status) {
    super(message);
    this.remedy = remedy;
    this.status = status;
  }
}

async function request(path, options, timeout_ms) {
  let response;
  try {
    response = await fetch(path, {
      credentials: "same-origin",
      cache: "no-store",
      redirect: "error",
      signal: AbortSignal.timeout(timeout_ms),
      ...options,
    });
  } catch {
    throw new OrderError("The console does not answer.", "Look at the terminal of `acquire console`.", 0);
  }
  const body = await response.json().catch(() => null);
  if (response.ok) return body;
  const error = body?.error ?? {};
  throw new OrderError(
    error.message ?? `The console answered ${response.status}.`,
    error.remedy ?? "",
    response.status,
  );
}

/** Send an order and return the answer; raises OrderError. */
export function post(path, content = {}, timeout_ms = ORDER_TIMEOUT_MS) {
  const headers = { "Content-Type": "application/json", "X-Percuss": "1" };
  return request(
    path,
    { method: "POST", headers, body: JSON.stringify(content), keepalive: true },
    timeout_ms,
  );
}

/** JSON of a GET request; raises OrderError. */
export const get = (path) => request(path, { headers: { "X-Percuss": "1" } }, ORDER_TIMEOUT_MS);

/** Send the stop, again after each failure; raises OrderError if no attempt was answered. */
export async function postStop() {
  for (let attempt = 1; ; attempt += 1) {
    try {
      return await post("/api/stop", {}, STOP_TIMEOUT_MS);
    } catch (error) {
      if (attempt === STOP_ATTEMPTS) throw error;
    }
  }
}
