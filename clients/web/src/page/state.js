// @ts-check
// The scene as the page has it: packed Gaussians, colours, and where each object is.

export const WIDTH = 2048;
/** Words of an object in the table: box and scale, then rotation by rows with the place. */
export const ROW = 24;
/** Fidelity of what is not there: a command removed it, or none has brought it in. */
const AWAY = 7;

/** Whether an object is in the world. @param {any} object */
export const isThere = (object) => object.figures.fidelity !== AWAY;

export class State {
  /** @param {any} about */
  constructor(about) {
    this.about = about;
    this.count = about.gaussians;
    this.rows = Math.max(1, Math.ceil(this.count / WIDTH));
    this.packed = new Uint32Array(this.rows * WIDTH * 4);
    this.turns = about.sh_degree > 0 ? new Uint32Array(this.rows * WIDTH) : null;
    /** Colour and opacity, then the number of the object. */
    this.paint = new Uint32Array(this.rows * WIDTH * 2);
    this.objects = about.objects.map((/** @type {any} */ info) => ({
      ...info, low: [0, 0, 0], extent: [0, 0, 0], place: [0, 0, 0], turn: [0, 0, 0, 1], figures: {},
      // Shown so far from where it is, until this step.
      shift: [0, 0, 0], until: null,
    }));
    this.table = new Float32Array(Math.max(1, this.objects.length) * ROW);
    this.version = 0;
    this.figuresAt = 0;
    this.figures = null;
    this.step = 0;
    this.time = 0;
    this.age = 0;
    this.arrived = 0;
    this.dropped = 0;
    this.dirty = { rows: /** @type {[number, number][]} */ ([]), paint: true };
  }

  /** Takes over an answer; says which scene it is of, and whether anything moved. @param {ArrayBuffer} buffer */
  take(buffer) {
    const view = new DataView(buffer);
    const u = (/** @type {number} */ at) => view.getUint32(at, true);
    const [scene, version, dropped, records, length] = [u(0), u(4), u(28), u(32), u(36)];
    if (scene !== this.about.scene) return { scene, moved: false };
    this.step = view.getFloat64(8, true);
    this.time = view.getFloat64(16, true);
    this.age = view.getFloat32(24, true);
    this.arrived = performance.now();
    this.dropped += dropped;
    let at = 40;
    if (length) {
      this.note(JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, at, length))));
      at += length;
    }
    for (let n = 0; n < records; n++) at = this.record(buffer, at);
    this.version = version;
    for (const object of this.objects) {
      if (object.until !== null && this.step >= object.until) this.settle(object);
    }
    return { scene, moved: records > 0 };
  }

  /** An object, or each, is shown where it is. @param {any} [only] */
  settle(only) {
    for (const object of only ? [only] : this.objects) Object.assign(object, { shift: [0, 0, 0], until: null });
  }

  /** @param {any} figures */
  note(figures) {
    this.figures = figures;
    this.figuresAt = figures.at;
    for (const row of figures.objects) {
      const object = this.objects.find((/** @type {any} */ o) => o.id === row.id);
      if (object) object.figures = row;
    }
  }

  /** @param {ArrayBuffer} buffer @param {number} at */
  record(buffer, at) {
    const [kind, id, first, count] = new Uint32Array(buffer, at, 4);
    const object = this.objects[id];
    at += 16;
    if (kind === 1) {
      const values = new Float32Array(buffer, at, 7);
      object.place = Array.from(values.subarray(0, 3));
      object.turn = Array.from(values.subarray(3, 7));
      return at + 28;
    }
    if (kind === 2) {
      const box = new Float32Array(buffer, at, 6);
      object.low = Array.from(box.subarray(0, 3));
      object.extent = Array.from(box.subarray(3, 6));
      at += 24;
      this.packed.set(new Uint32Array(buffer, at, 4 * count), 4 * first);
      at += 16 * count;
      if (this.turns) {
        this.turns.set(new Uint32Array(buffer, at, count), first);
        at += 4 * count;
      }
      this.dirty.rows.push([Math.floor(first / WIDTH), Math.ceil((first + count) / WIDTH)]);
      return at;
    }
    const colours = new Uint32Array(buffer, at, count);
    for (let n = 0; n < count; n++) {
      this.paint[2 * (first + n)] = colours[n];
      this.paint[2 * (first + n) + 1] = id;
    }
    this.dirty.paint = true;
    return at + 4 * count;
  }

  /** Fills the table of objects: `tint` says colour and share of it. @param {(object: any) => number[]} tint */
  fill(tint) {
    this.objects.forEach((/** @type {any} */ object, /** @type {number} */ n) => {
      const r = matrix(object.turn), [low, extent] = [object.low, object.extent];
      const place = object.place.map((/** @type {number} */ x, /** @type {number} */ a) => x + object.shift[a]);
      this.table.set([
        ...low, 0, ...extent.map((/** @type {number} */ x) => x / 65535), 0,
        r[0], r[1], r[2], place[0], r[3], r[4], r[5], place[1], r[6], r[7], r[8], place[2],
        ...tint(object),
      ], n * ROW);
    });
  }

  /** Smallest and largest corner of an object's box, in the world. @param {any} object */
  corner(object) {
    const r = matrix(object.turn);
    const half = object.extent.map((/** @type {number} */ x) => x / 2);
    const middle = object.low.map((/** @type {number} */ x, /** @type {number} */ a) => x + half[a]);
    return [0, 1, 2].map((a) => object.place[a] + r[3 * a] * middle[0] + r[3 * a + 1] * middle[1] + r[3 * a + 2] * middle[2]);
  }
}

/** Rotation matrix of a quaternion xyzw, by rows. @param {number[]} q */
export function matrix([x, y, z, w]) {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
    2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
    2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y),
  ];
}
