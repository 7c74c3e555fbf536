/** Estimates of this session that the page has seen, so that earlier ellipses can be drawn. */

const MOST = 40;
const key = (session) => `percuss-estimates-${session?.id ?? ""}`;

let session_id = null;
let estimates = [];

function load(session) {
  try {
    const read = JSON.parse(sessionStorage.getItem(key(session)) ?? "[]");
    return Array.isArray(read) ? read : [];
  } catch {
    return [];
  }
}

/** Estimates from old to new, with the snapshot's own as the last; one for each number of strikes. */
export function estimatesOf(snapshot) {
  const { session, estimate } = snapshot;
  if ((session?.id ?? "") !== session_id) {
    session_id = session?.id ?? "";
    estimates = load(session);
  }
  if (!estimate) return estimates;
  const text = JSON.stringify(estimate);
  if (JSON.stringify(estimates.at(-1)) === text) return estimates;
  estimates = [...estimates.filter((each) => each.strikes < estimate.strikes), JSON.parse(text)].slice(-MOST);
  try {
    sessionStorage.setItem(key(session), JSON.stringify(estimates));
  } catch {
    // Without storage, earlier ellipses are lost when the page is loaded again.
  }
  return estimates;
}
