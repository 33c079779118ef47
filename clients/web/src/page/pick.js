// @ts-check
// What is seen at a pixel: front to back, the first Gaussian at which less than half of the light behind passes. It is the
// rule of `cosplat ctl pick`, over the Gaussians as this page has them.

import { isThere, matrix } from './state.js';

const LEAST = 1 / 255;
const LARGEST = 0.99;
/** Nothing is carried to so many times its distance. */
const FAR = 10;
const dot = (/** @type {ArrayLike<number>} */ a, /** @type {ArrayLike<number>} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const sum = (/** @type {number[]} */ a, /** @type {number[]} */ b, s = 1) => a.map((x, n) => x + s * b[n]);

/** The box of an object as its Gaussians are counted in: origin, steps along its axes, rotation by rows. @param {any} object */
function frame(object) {
  const turn = matrix(object.turn), rows = [turn.slice(0, 3), turn.slice(3, 6), turn.slice(6, 9)];
  const step = object.extent.map((/** @type {number} */ x) => x / 65535);
  const origin = rows.map((row, a) => object.place[a] + dot(row, object.low));
  return { rows, origin, steps: rows.map((row) => row.map((x, a) => x * step[a])) };
}

/** Where a Gaussian is [m]. @param {import('./state.js').State} state @param {any} object @param {number} n */
export function centre(state, object, n) {
  const { origin, steps } = frame(object), w0 = state.packed[4 * n], w1 = state.packed[4 * n + 1];
  return origin.map((x, a) => x + dot(steps[a], [w0 & 65535, w0 >>> 16, w1 & 65535]));
}

/** The point of the view at this pixel and depth [m]. @param {any} view @param {number} x @param {number} y @param {number} depth */
export function pointAt(view, x, y, depth) {
  const right = ((x - view.width / 2) / view.focal) * depth, down = ((y - view.height / 2) / view.focal) * depth;
  return sum(sum(sum(view.position, view.forward, depth), view.right, right), view.down, down);
}

/** Where the ray of a pixel meets the plane through a point; none behind the camera or far off.
 * @param {any} view @param {number[]} pixel @param {number[]} point @param {number[]} normal */
export function meet(view, pixel, point, normal) {
  const along = sum(pointAt(view, pixel[0], pixel[1], 1), view.position, -1), from = sum(point, view.position, -1);
  const depth = dot(from, normal) / dot(along, normal);
  return depth > view.near && depth < FAR * dot(from, view.forward) ? sum(view.position, along, depth) : null;
}

/** The pixel at which a point is seen. @param {any} view @param {number[]} point */
export function pixelOf(view, point) {
  const from = sum(point, view.position, -1), depth = dot(from, view.forward);
  return [view.width / 2 + (view.focal * dot(from, view.right)) / depth, view.height / 2 + (view.focal * dot(from, view.down)) / depth];
}

/** @param {import('./state.js').State} state @param {any} view @param {number} x pixel, whose centre is at a half @param {number} y */
export function pick(state, view, x, y) {
  const { packed, paint } = state, met = /** @type {{ object: number, gaussian: number, depth: number, opacity: number }[]} */ ([]);
  state.objects.forEach((/** @type {any} */ object, /** @type {number} */ number) => {
    if (!isThere(object)) return;
    const { rows, origin, steps } = frame(object), [sx, sy, sz] = steps;
    const o = sum(origin, view.position, -1);
    const along = (/** @type {number[]} */ axis) =>
      [dot(axis, o), axis[0] * sx[0] + axis[1] * sy[0] + axis[2] * sz[0], axis[0] * sx[1] + axis[1] * sy[1] + axis[2] * sz[1], axis[0] * sx[2] + axis[1] * sy[2] + axis[2] * sz[2]];
    const [f, r, d] = [along(view.forward), along(view.right), along(view.down)];
    for (let n = object.first, end = object.first + object.count; n < end; n++) {
      const w0 = packed[4 * n], w1 = packed[4 * n + 1], exponent = (w1 >>> 16) & 255;
      const a = w0 & 65535, b = w0 >>> 16, c = w1 & 65535;
      const depth = f[0] + f[1] * a + f[2] * b + f[3] * c;
      if (exponent === 0 || !(depth >= view.near)) continue;
      const [slopeX, slopeY] = [(r[0] + r[1] * a + r[2] * b + r[3] * c) / depth, (d[0] + d[1] * a + d[2] * b + d[3] * c) / depth];
      const dx = x - view.width / 2 - view.focal * slopeX, dy = y - view.height / 2 - view.focal * slopeY;
      const base = (paint[2 * n] >>> 24) / 255;
      // No entry of the factor is larger than the power of two: sizes are at most the root of three times that.
      const scale = (view.focal / depth) * 2 ** (exponent - 128);
      const slope = 1 + Math.hypot(slopeX, slopeY), reach = 3.4 * (1.8 * scale * slope + 0.6);
      if (base <= LEAST || dx * dx + dy * dy > reach * reach) continue;
      const opacity = base * Math.exp(-0.5 * distance(packed, n, rows, view, slopeX, slopeY, scale, dx, dy));
      if (opacity >= LEAST) met.push({ object: number, gaussian: n, depth, opacity: Math.min(opacity, LARGEST) });
    }
  });
  met.sort((one, other) => one.depth - other.depth);
  let passes = 1;
  const seen = met.find(({ opacity }) => (passes *= 1 - opacity) < 0.5);
  return seen ? { ...seen, point: pointAt(view, x, y, seen.depth) } : null;
}

/** Squared Mahalanobis distance of a pixel from a projected Gaussian, by the rules of the shader.
 * @param {Uint32Array} packed @param {number} n @param {number[][]} rows @param {any} view
 * @param {number} slopeX @param {number} slopeY @param {number} scale @param {number} dx @param {number} dy */
function distance(packed, n, rows, view, slopeX, slopeY, scale, dx, dy) {
  const [w1, w2, w3] = [packed[4 * n + 1], packed[4 * n + 2], packed[4 * n + 3]];
  const diagonal = (/** @type {number} */ bits) => (bits & 4095) / 4095;
  const entry = (/** @type {number} */ bits) => ((bits & 4095) - 2048) / 2047;
  const [l00, l10, l20] = [diagonal((w1 >>> 24) | (w2 << 8)), entry(w2 >>> 4), entry(w2 >>> 16)];
  const [l11, l21, l22] = [diagonal((w2 >>> 28) | (w3 << 4)), entry(w3 >>> 8), diagonal(w3 >>> 20)];
  const limit = (/** @type {number} */ slope, /** @type {number} */ size) => Math.min(1, Math.max(-1, slope / ((0.65 * size) / view.focal))) * ((0.65 * size) / view.focal);
  const row = (/** @type {number[]} */ axis, /** @type {number} */ slope) => {
    const j = axis.map((value, a) => (value - view.forward[a] * slope) * scale);
    const [ox, oy, oz] = [0, 1, 2].map((a) => rows[0][a] * j[0] + rows[1][a] * j[1] + rows[2][a] * j[2]);
    return [ox * l00 + oy * l10 + oz * l20, oy * l11 + oz * l21, oz * l22];
  };
  const tx = row(view.right, limit(slopeX, view.width)), ty = row(view.down, limit(slopeY, view.height));
  const xx = dot(tx, tx) + 0.3, yy = dot(ty, ty) + 0.3, xy = dot(tx, ty), determinant = xx * yy - xy * xy;
  return (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / determinant;
}
