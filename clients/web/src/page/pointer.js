// @ts-check
// Mouse and touch: what a press in the picture does is the tool's matter, from the background it turns the camera.

import { steer } from './camera.js';
import { centre, meet, pick, pixelOf, pointAt } from './pick.js';

const $ = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
/** A hold ends by itself so long after its last order [s]. */
const PATIENCE = 1;
/** Orders of a hold that stands still come so often [ms], well within that. */
const BEAT_MS = 250;
/** Movement up to which a press is a click [pixel]. */
const CLICK = 4;
const ONLY_SHOWN = 1;
/** From a view flatter than this sine, objects are carried along the picture. */
const LEVEL = 0.1;
const dot = (/** @type {number[]} */ a, /** @type {number[]} */ b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const sum = (/** @type {number[]} */ a, /** @type {number[]} */ b, s = 1) => a.map((x, n) => x + s * b[n]);

export class Pointer {
  /** @param {any} page @param {HTMLCanvasElement} canvas */
  constructor(page, canvas) {
    this.page = page;
    this.canvas = canvas;
    this.fingers = new Map();
    this.hold = /** @type {any} */ (null);
    /** What is carried elsewhere, the point of it that is carried, and where its centre of mass was. */
    this.carried = /** @type {any} */ (null);
    /** What is painted, and where the latest order painted it. */
    this.stroke = /** @type {any} */ (null);
    this.pressed = /** @type {any} */ (null);
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const end of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(end, (event) => this.up(/** @type {PointerEvent} */ (event)));
    }
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      page.camera?.zoom(Math.exp(event.deltaY * 0.001));
      page.redraw();
    }, { passive: false });
    setInterval(() => this.send(), BEAT_MS);
  }

  /** Where an event is in the picture [pixel]. @param {MouseEvent} event */
  at(event) {
    const scale = this.canvas.width / this.canvas.clientWidth;
    return [event.clientX * scale, event.clientY * scale];
  }

  /** @param {PointerEvent} event */
  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const { state, view } = { state: this.page.state, view: this.page.view() };
    if (this.fingers.size > 1) return this.end(true);
    const isMove = $('tool').value === 'move' || event.ctrlKey || event.metaKey;
    if (!state || event.button !== 0 || (event.shiftKey && !isMove)) return;
    const [x, y] = this.at(event), found = pick(state, view, Math.floor(x) + 0.5, Math.floor(y) + 0.5);
    this.pressed = { found, x: event.clientX, y: event.clientY, isClick: true };
    const object = found && state.objects[found.object];
    if (object && isMove && !$('tool').disabled) return this.lift(found, object);
    if (!object || object.fidelity === ONLY_SHOWN || $('tool').disabled) return;
    if ($('tool').value === 'hand') this.grab(found, object);
    if ($('tool').value === 'paint') this.paint(found, object);
  }

  /** Gives what is there the material of the panel. @param {any} found @param {any} object */
  paint(found, object) {
    this.stroke = { object, point: found.point };
    this.busy = this.page.panel.paint(object, found.point, this.patch(object)).then(() => { this.busy = null; });
  }

  /** Paints on where the pointer is half a patch farther on the same object, one order at a time. @param {MouseEvent} event */
  paintOn(event) {
    const [x, y] = this.at(event), { object, point } = this.stroke, { state } = this.page;
    const found = !this.busy && pick(state, this.page.view(), Math.floor(x) + 0.5, Math.floor(y) + 0.5);
    if (!found || state.objects[found.object] !== object) return;
    if (Math.hypot(...sum(found.point, point, -1)) > this.patch(object) / 2) this.paint(found, object);
  }

  /** @param {any} found @param {any} object */
  lift(found, object) {
    this.page.panel.select(found.object);
    this.page.state.settle(object);
    if (object.figures.com) this.carried = { object, point: found.point, com: object.figures.com };
  }

  /** Carries along a level plane, or with Shift straight up and down.
   * @param {number[]} before pixels @param {number[]} now @param {boolean} isRaised */
  carry(before, now, isRaised) {
    const { object, point } = this.carried, view = this.page.view();
    const at = sum(point, object.shift);
    const isLevel = !isRaised && Math.abs(dot(view.forward, view.up)) > LEVEL;
    const [from, to] = [before, now].map((pixel) => meet(view, pixel, at, isLevel ? view.up : view.forward));
    // Above the horizon there is nothing level.
    if (!from || !to) return;
    const by = sum(to, from, -1);
    object.shift = sum(object.shift, isRaised ? view.up.map((/** @type {number} */ x) => x * dot(by, view.up)) : by);
  }

  /** @param {any} found @param {any} object */
  grab(found, object) {
    this.page.panel.select(found.object);
    this.hold = { ...found, object, to: found.point, isSent: true, isHeld: false };
    const steps = Math.ceil(Math.max(60, PATIENCE * (this.page.state.figures?.status?.rate ?? 60)));
    const hold = this.hold;
    this.busy = this.page.order({ action: 'grab', object: object.id, point: found.point, radius: this.patch(object), steps })
      .then((/** @type {any} */ answer) => {
        hold.isHeld = Boolean(answer) && !answer.refused;
        this.busy = null;
        if (this.hold === hold && !hold.isHeld) this.hold = null;
        this.mark();
        this.send();
      });
  }

  /** How much of an object a tool takes hold of [m]. @param {any} object */
  patch(object) { return Math.max(1e-4, Number($('patch').value) * (object.figures.radius || 0.1)); }

  /** Sends the newest target, one order at a time: what a slow answer leaves behind is left out. */
  send() {
    const hold = this.hold;
    if (!hold?.isHeld || this.busy) return;
    this.busy = this.page.order({ action: 'drag', object: hold.object.id, to: hold.to }).then(() => {
      this.busy = null;
      if (hold.isMoved) {
        hold.isMoved = false;
        this.send();
      }
    });
  }

  /** Ends what a press began. @param {boolean} isDropped whether what was carried goes back */
  end(isDropped) {
    const carried = this.carried;
    this.carried = this.stroke = null;
    this.letGo();
    if (!carried) return;
    const { object, com } = carried;
    if (isDropped || !this.pressed || this.pressed.isClick) this.page.state.settle(object);
    else this.page.panel.edits.carry(object, sum(com, object.shift));
  }

  async letGo() {
    const hold = this.hold;
    this.hold = null;
    this.mark();
    if (!hold) return;
    // The grab, or the last drag, comes first.
    await this.busy;
    if (hold.isHeld) await this.page.order({ action: 'let-go', object: hold.object.id });
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { camera } = this.page, before = this.fingers.get(event.pointerId);
    if (!before || !camera) return;
    const now = [event.clientX, event.clientY], pressed = this.pressed;
    if (pressed && Math.hypot(now[0] - pressed.x, now[1] - pressed.y) > CLICK) pressed.isClick = false;
    if (this.carried) {
      const scale = this.canvas.width / this.canvas.clientWidth;
      this.carry(before.map((/** @type {number} */ n) => n * scale), this.at(event), event.shiftKey);
    } else if (this.stroke) {
      this.paintOn(event);
    } else if (this.hold) {
      this.hold.to = pointAt(this.page.view(), ...this.at(event), this.hold.depth);
      this.hold.isMoved = Boolean(this.busy);
      this.send();
      this.mark();
    } else {
      steer(camera, this.fingers, event, this.canvas.clientHeight);
    }
    this.fingers.set(event.pointerId, now);
    this.page.redraw();
  }

  /** @param {PointerEvent} event */
  up(event) {
    this.fingers.delete(event.pointerId);
    const pressed = this.pressed, found = pressed?.found;
    this.end(event.type === 'pointercancel');
    this.pressed = null;
    // What is painted is not selected: that would show its own material in the panel.
    if (!pressed?.isClick || !found || event.type === 'pointercancel' || $('tool').value === 'paint') return;
    this.page.panel.select(found.object);
    const object = this.page.state.objects[found.object];
    if ($('tool').value !== 'push' || $('tool').disabled || object.fidelity === ONLY_SHOWN) return;
    const size = Number($('strength').value) * (object.figures.mass ?? 0);
    const impulse = this.page.view().forward.map((/** @type {number} */ x) => x * size);
    this.page.order({ action: 'push', object: object.id, impulse, point: found.point, radius: this.patch(object) });
  }

  /** Draws what is held and where it is pulled to. */
  mark() {
    const hold = this.hold, mark = $('mark');
    mark.toggleAttribute('hidden', !hold);
    if (!hold || !this.page.state) return;
    const view = this.page.view(), scale = this.canvas.clientWidth / this.canvas.width;
    const held = pixelOf(view, centre(this.page.state, hold.object, hold.gaussian)), to = pixelOf(view, hold.to);
    const line = mark.querySelector('line'), [from, end] = mark.querySelectorAll('circle');
    [[line, 'x1', held[0]], [line, 'y1', held[1]], [line, 'x2', to[0]], [line, 'y2', to[1]], [from, 'cx', held[0]], [from, 'cy', held[1]],
      [end, 'cx', to[0]], [end, 'cy', to[1]]].forEach(([shape, name, value]) => shape.setAttribute(name, String(value * scale)));
  }
}
