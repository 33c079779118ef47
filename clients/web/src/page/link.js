// @ts-check
// Requests to the server that served this page, with the token of the link.

const token = location.hash.slice(1).split('&')[0];
/** What this page holds is held by this number, until the page lets go of it or is gone. */
const page = crypto.getRandomValues(new Uint32Array(1))[0] + 1;

/** @param {string} path @param {RequestInit} [more] */
async function ask(path, more = {}) {
  const answer = await fetch(path, { ...more, headers: { 'x-cosplat-token': token }, cache: 'no-store' });
  if (answer.ok) return answer;
  const text = await answer.text();
  let why = text;
  try { why = JSON.parse(text).refused; } catch { /* not ours: shown as it is */ }
  const error = new Error(why || `the server answered ${answer.status}`);
  throw Object.assign(error, { status: answer.status });
}

export const scene = async () => (await ask('/scene')).json();
export const harmonics = async () => (await ask('/harmonics')).arrayBuffer();

/** What is newer than what the page has. @param {number} scene @param {number} version @param {number | null} figures */
export async function frame(scene, version, figures) {
  const wanted = figures === null ? '' : `&figures=${figures}`;
  return (await ask(`/frame?scene=${scene}&version=${version}${wanted}`)).arrayBuffer();
}

/** Sends an order in the words of a script, and gives back its answer. @param {object} order @param {number} [step] */
export async function order(order, step = 0) {
  return (await ask('/command', { method: 'POST', body: JSON.stringify({ order, step, page }) })).json();
}

/** The objects of strokes, and of one more line: what is said of them, and the object of each Gaussian.
 * @param {object} asked */
export async function strokes(asked) {
  const buffer = await (await ask('/strokes', { method: 'POST', body: JSON.stringify(asked) })).arrayBuffer();
  const length = new Uint32Array(buffer, 0, 1)[0];
  const told = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { ...told, label: new Int32Array(buffer, 4 + length) };
}
