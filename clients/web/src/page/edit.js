// @ts-check
// Objects are put elsewhere, taken out, brought in and remodelled, and edits are taken back.

import { isThere } from './state.js';

const $ = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const PLACE = ['at-x', 'at-y', 'at-z'];
const TURN = ['turn-x', 'turn-y', 'turn-z'];

export class Edits {
  /** @param {any} page @param {() => any} selected what edits are about */
  constructor(page, selected) {
    this.page = page;
    this.selected = selected;
    /** A person has typed a place: it is not written over. */
    this.isTyped = false;
    /** The place that the fields show [m], of which they have room for some digits. */
    this.place = /** @type {number[] | null} */ (null);
    /** What the controls show of edits of this page, newest last, and of those that were undone. */
    this.done = /** @type {Shown[]} */ ([]);
    this.undone = /** @type {Shown[]} */ ([]);
    for (const id of [...PLACE, ...TURN]) {
      $(id).oninput = () => { this.isTyped = true; };
      $(id).onkeydown = (/** @type {KeyboardEvent} */ event) => { if (event.key === 'Enter') this.put(); };
    }
    $('move').onclick = () => this.put();
    $('remove').onclick = () => this.remove();
    $('bring-in').onclick = () => this.bringIn();
    $('undo').onclick = () => this.undo();
    $('redo').onclick = () => this.redo();
    $('model').onchange = () => this.model();
  }

  /** Another object is selected, or what was typed was used. */
  clear() {
    this.isTyped = false;
    for (const id of [...PLACE, ...TURN]) $(id).value = '';
    this.show();
  }

  show() {
    const object = this.selected(), isIn = object && isThere(object);
    $('move').disabled = $('remove').disabled = $('model').disabled = !isIn;
    $('bring-in').disabled = !object || isIn;
    if (this.isTyped) return;
    this.place = isIn ? object.figures.com ?? null : null;
    PLACE.forEach((id, a) => {
      $(id).value = this.place ? figure(this.place[a], this.digits()) : '';
      $(id).title = this.place ? `${this.place[a]} m` : '';
    });
  }

  /** Digits behind the point with which a place is shown: a hundred-thousandth of the scene, or two. */
  digits() {
    const { low, high } = this.page.state.about;
    const size = Math.max(...high.map((/** @type {number} */ x, /** @type {number} */ a) => x - low[a]));
    return Math.min(9, Math.max(0, 4 - Math.floor(Math.log10(size > 0 ? size : 1))));
  }

  /** Place and turn as typed; what is left empty is kept, and a number that nobody changed is what it was to the last digit. */
  typed() {
    const [place, turn] = [PLACE, TURN].map((ids) => ids.map((id) => $(id).value));
    const pose = /** @type {{ position?: number[], rotation_deg?: number[] }} */ ({});
    const own = this.place, digits = this.digits();
    if (this.isTyped && place.every((text) => text !== '')) {
      pose.position = place.map((text, a) => (own && text === figure(own[a], digits) ? own[a] : Number(text)));
    }
    if (turn.some((text) => text !== '')) pose.rotation_deg = turn.map(Number);
    return pose;
  }

  /** Puts the selected object where the numbers say. */
  put() {
    const object = this.selected(), pose = this.typed();
    if (!object) return;
    if (!isThere(object)) return this.bringIn();
    if (!pose.position && !pose.rotation_deg) return this.page.say('type x, y and z of a place, or a turn');
    return this.ordered('put there', { action: 'set-pose', object: object.id, ...pose });
  }

  /** Puts an object where it was dragged to. @param {any} object @param {number[]} position of its centre of mass [m] */
  async carry(object, position) {
    const answer = await this.ordered('put there', { action: 'set-pose', object: object.id, position });
    // It is shown there until frames show it.
    if (answer) object.until = answer.step;
    else object.shift = [0, 0, 0];
    this.page.redraw();
  }

  remove() {
    const object = this.selected();
    return object && this.ordered('removed', { action: 'remove', object: object.id });
  }

  bringIn() {
    const object = this.selected();
    return object && this.ordered('brought in', { action: 'bring-in', object: object.id, ...this.typed() });
  }

  model() {
    const object = this.selected(), fidelity = $('model').value;
    $('model').value = '';
    return object && fidelity && this.ordered(`modelled as ${fidelity}`, { action: 'set-fidelity', object: object.id, fidelity });
  }

  undo() { return this.back('undone', 'undo', this.done, this.undone, (shown) => shown.before()); }

  redo() { return this.back('redone', 'redo', this.undone, this.done, (shown) => shown.after()); }

  /** @param {string} words @param {string} action @param {Shown[]} from @param {Shown[]} to @param {(shown: Shown) => void} show */
  async back(words, action, from, to, show) {
    const answer = await this.obeyed(words, { action });
    if (!answer) return;
    // An edit of somebody else shows nothing here.
    const shown = from.pop();
    if (shown) {
      to.push(shown);
      show(shown);
    }
    this.page.state?.settle();
    this.clear();
    this.page.redraw();
  }

  /** Gives an order that is an edit. @param {string} words what was done @param {object} order @param {Shown} [shown] by controls */
  async ordered(words, order, shown = NOTHING) {
    const answer = await this.obeyed(words, order);
    if (!answer) return null;
    shown.after();
    this.done.push(shown);
    this.undone.length = 0;
    this.clear();
    return answer;
  }

  /** The answer to an order that was not refused. @param {string} words @param {object} order */
  async obeyed(words, order) {
    this.page.say('');
    const answer = await this.page.order(order);
    if (!answer || answer.refused) return null;
    const waits = this.page.panel.isPaused ? '; Step makes it' : '';
    this.page.say(`${words} as step ${answer.step} begins${waits}`);
    return answer;
  }
}

/** A number without an exponent, which a narrow field would cut off: `-2.29e-17` is 0. @param {number} value @param {number} digits */
function figure(value, digits) {
  if (!Number.isFinite(value)) return '';
  const text = value.toFixed(digits);
  return (text.includes('.') ? text.replace(/\.?0+$/, '') : text).replace(/^-0$/, '0');
}

/** What controls show before and after an edit.
 * @typedef {{ before: () => void, after: () => void }} Shown */
const NOTHING = { before() {}, after() {} };
