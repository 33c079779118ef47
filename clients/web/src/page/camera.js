// @ts-check
// The camera circles a point; its angles and framing are those of `cosplat view`.

const MARGIN = 0.08;
const TAN = Math.tan((20 * Math.PI) / 180);
const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (/** @type {number[]} */ a, /** @type {number[]} */ b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const sum = (/** @type {number[]} */ a, /** @type {number[]} */ b, s = 1) => a.map((x, n) => x + s * b[n]);
const unit = (/** @type {number[]} */ a) => a.map((x) => x / Math.sqrt(dot(a, a)));

/** Signed axis against gravity; z without any. @param {number[]} gravity */
export function upOf(gravity) {
  let axis = -1, largest = 0;
  for (const a of [2, 1, 0]) {
    if (Math.abs(gravity[a]) > largest) [axis, largest] = [a, Math.abs(gravity[a])];
  }
  const up = [0, 0, 0];
  if (axis < 0) up[2] = 1;
  else up[axis] = gravity[axis] < 0 ? 1 : -1;
  return up;
}

export class Camera {
  /** @param {any} about */
  constructor(about) {
    this.up = upOf(about.gravity);
    this.low = about.low;
    this.high = about.high;
    this.reset();
  }

  reset() {
    this.azimuth = (35 * Math.PI) / 180;
    this.elevation = (20 * Math.PI) / 180;
    this.distance = /** @type {number | null} */ (null);
    this.target = sum(this.low, sum(this.high, this.low, -1), 0.5);
  }

  /** Axes, place and focal length for a picture of this size [pixel]. @param {number} width @param {number} height */
  look(width, height) {
    const limit = (89.9 * Math.PI) / 180;
    this.elevation = Math.min(limit, Math.max(-limit, this.elevation));
    const up = this.up;
    const front = up[0] ? [0, 0, 1] : up[1] ? [0, 0, up[1]] : [0, -up[2], 0];
    const level = sum(front.map((x) => x * Math.cos(this.azimuth)), cross(up, front), Math.sin(this.azimuth));
    const away = sum(level.map((x) => x * Math.cos(this.elevation)), up, Math.sin(this.elevation));
    const forward = away.map((x) => -x);
    const right = unit(cross(forward, up));
    const down = cross(forward, right);
    const aspect = width / height;
    if (this.distance === null) {
      const centre = sum(this.low, sum(this.high, this.low, -1), 0.5);
      let fit = 0;
      for (let corner = 0; corner < 8; corner++) {
        const point = [0, 1, 2].map((a) =>
          (corner & (1 << a) ? 1 : -1) * Math.max(1e-6, (this.high[a] - this.low[a]) / 2) + centre[a] - this.target[a]);
        const x = Math.abs(dot(point, right)) / (TAN * aspect), y = Math.abs(dot(point, down)) / TAN;
        fit = Math.max(fit, Math.max(x, y) / (1 - MARGIN) - dot(point, forward));
      }
      this.fitted = fit;
    }
    const distance = this.distance ?? this.fitted ?? 1;
    return {
      right, down, forward, position: sum(this.target, away, distance), distance,
      focal: (0.5 * height) / TAN, width, height, near: 0.01 * distance,
    };
  }

  /** @param {number} right [rad] @param {number} up [rad] */
  turn(right, up) {
    this.azimuth += right;
    this.elevation += up;
  }

  /** Shifts what is seen by parts of the picture's height. @param {number} x @param {number} y */
  shift(x, y) {
    const view = this.look(1, 1);
    const scale = 2 * TAN * view.distance;
    this.target = sum(sum(this.target, view.right, -x * scale), view.down, -y * scale);
    this.distance = view.distance;
  }

  /** @param {number} factor */
  zoom(factor) {
    this.distance = Math.min(1e6, Math.max(1e-4, this.look(1, 1).distance * factor));
  }
}

/** What a finger or the mouse that moves from `before` to `now` does to the camera: turns it; with Shift, the right button or a
 * second finger shifts it, and two fingers move nearer and away.
 * @param {Camera} camera @param {Map<number, number[]>} fingers where they are, this one before it moved
 * @param {PointerEvent} event @param {number} size height of the picture, in the units of the event */
export function steer(camera, fingers, event, size) {
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const now = [event.clientX, event.clientY], [x, y] = [now[0] - before[0], now[1] - before[1]];
  if (fingers.size === 2) {
    const other = [...fingers.entries()].filter(([id]) => id !== event.pointerId)[0][1];
    const span = (/** @type {number[]} */ a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
    camera.zoom(span(before) / Math.max(1, span(now)));
    camera.shift(x / 2 / size, y / 2 / size);
  } else if (event.buttons & 2 || event.shiftKey) {
    camera.shift(x / size, y / size);
  } else {
    camera.turn((-x / size) * Math.PI, (y / size) * Math.PI);
  }
}

/** Gives a canvas as many pixels as it has on the screen; whether that is another number than before. @param {HTMLCanvasElement} canvas */
export function fit(canvas) {
  const ratio = Math.min(2, window.devicePixelRatio);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((n) => Math.max(1, Math.round(n * ratio)));
  if (canvas.width === width && canvas.height === height) return false;
  [canvas.width, canvas.height] = [width, height];
  return true;
}
