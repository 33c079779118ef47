// @ts-check
// The controls beside the picture.

import { Charts, short } from './charts.js';
import { Edits } from './edit.js';
import { isThere } from './state.js';

export const LEVELS = {
  1: ['only shown', [0.6, 0.6, 0.6]], 2: ['matter', [0.9, 0.25, 0.2]], 3: ['asleep', [0.25, 0.45, 0.9]],
  4: ['rigid', [0.95, 0.75, 0.15]], 5: ['affine', [0.6, 0.3, 0.8]], 6: ['gone', [0.2, 0.2, 0.2]], 7: ['removed', [0, 0, 0]],
};

const $ = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));

/** What limits a substep, by its number on the wire. */
const LIMITS = ['the frame', 'speed of sound', 'velocity', 'deformation'];

export class Panel {
  /** @param {any} page */
  constructor(page) {
    this.page = page;
    this.selected = -1;
    this.state = /** @type {any} */ (null);
    this.edits = new Edits(page, () => this.object);
    this.charts = new Charts($('charts'), [
      ['kinetic', 'J', (f) => f.status.kinetic], ['elastic', 'J', (f) => f.status.elastic],
      ['contact', 'N s', () => this.state.objects.reduce((/** @type {number} */ s, /** @type {any} */ o) => s + (o.figures.contact ?? 0), 0)],
      ['rate', 'steps/s', (f) => f.status.rate], ['matter modelled', '%', (f) => 100 * f.status.modelled],
    ]);
    $('pause').onclick = () => this.pause();
    $('step').onclick = () => this.step();
    $('reset').onclick = () => this.reset();
    $('time').oninput = () => this.seek(Number($('time').value));
    $('levels').onchange = () => page.changed();
    $('strength').oninput = () => this.strength();
    $('preset').onchange = () => this.sliders();
    $('apply').onclick = () => this.apply();
    $('freeze').onclick = () => this.freeze();
    $('thaw').onclick = () => this.thaw();
    $('tool').onchange = () => this.tool($('tool').value);
    this.tool('hand');
    $('g').oninput = () => { $('g-out').value = `${short(Number($('g').value))} m/s\u00b2`; };
    $('g').onchange = () => this.gravity();
    for (const button of document.querySelectorAll('[data-push]')) {
      /** @type {HTMLElement} */ (button).onclick = () => this.push(/** @type {HTMLElement} */ (button).dataset.push ?? '');
    }
    this.strength();
    /** Strength of gravity [m/s^2]. */
    this.g = 0;
    this.sought = /** @type {number | null} */ (null);
    this.isSeeking = false;
  }

  /** @param {import('./state.js').State} state */
  begin(state) {
    this.state = state;
    const about = state.about;
    document.title = `cosplat: ${about.session}`;
    $('preset').replaceChildren(...about.presets.map((/** @type {any} */ p) => new Option(p.name)));
    $('objects').replaceChildren(...state.objects.map((/** @type {any} */ object, /** @type {number} */ n) => {
      const item = document.createElement('li');
      item.setAttribute('role', 'option');
      item.onclick = () => this.select(n);
      item.append(object.name, document.createElement('small'));
      return item;
    }));
    const range = about.recorded;
    for (const id of ['push', 'material', 'gravity', 'hold', 'edit', 'tool']) $(id).disabled = about.read_only || Boolean(range);
    for (const id of ['pause', 'step', 'reset', 'time']) $(id).disabled = about.read_only;
    $('time-line').hidden = !range;
    document.body.classList.toggle('recorded', Boolean(range));
    if (range) [$('time').min, $('time').max] = range;
    this.g = $('g').value = Math.hypot(...about.gravity);
    $('g').oninput();
    const moves = state.objects.findIndex((/** @type {any} */ o) => o.fidelity !== 1);
    this.select(Math.max(0, moves));
    this.show();
  }

  /** What is selected. */
  get object() { return this.state?.objects[this.selected]; }

  get isPaused() { return this.state?.figures?.status?.state === 2; }

  pause() { return this.page.order({ action: this.isPaused ? 'resume' : 'pause' }); }

  reset() {
    const range = this.state?.about.recorded;
    return range ? this.seek(range[0]) : this.page.order({ action: 'reset' });
  }

  /** Goes to a step of the recording; of several asked for while one is sought, to the newest. @param {number} step */
  async seek(step) {
    const range = this.state?.about.recorded;
    if (!range) return;
    this.sought = Math.min(range[1], Math.max(range[0], step));
    if (this.isSeeking) return;
    this.isSeeking = true;
    while (this.sought !== null) {
      const wanted = this.sought;
      await this.page.order({ action: 'seek' }, wanted);
      if (this.sought === wanted) this.sought = null;
    }
    this.isSeeking = false;
  }

  async step() {
    if (this.state?.about.recorded) return this.seek(this.state.step + 1);
    if (!this.isPaused) await this.page.order({ action: 'pause' });
    await this.page.order({ action: 'step', count: 1 });
  }

  /** @param {number} n */
  select(n) {
    if (!this.state?.objects.length) return;
    this.selected = (n + this.state.objects.length) % this.state.objects.length;
    [...$('objects').children].forEach((item, i) => item.setAttribute('aria-selected', String(i === this.selected)));
    const object = this.state.objects[this.selected];
    $('preset').value = object.material;
    // A material of the scene's own: its numbers begin with those of the first preset.
    if ($('preset').selectedIndex < 0) $('preset').selectedIndex = 0;
    this.sliders(object);
    this.edits.clear();
    this.page.changed();
  }

  strength() { $('strength-out').value = `${$('strength').value} m/s`; }

  /** An impulse that gives the selected object the chosen speed. @param {string} way */
  push(way) {
    const object = this.object;
    if (!object?.figures.mass) return;
    const { right, down, forward } = this.page.view();
    const [axis, sign] = /** @type {Record<string, [number[], number]>} */ ({
      left: [right, -1], right: [right, 1], up: [down, -1], down: [down, 1], away: [forward, 1], near: [forward, -1],
    })[way];
    const size = sign * Number($('strength').value) * object.figures.mass;
    return this.page.order({ action: 'push', object: object.id, impulse: axis.map((x) => x * size) });
  }

  /** Another tool for presses in the picture; the next one without a name. @param {string} [name] */
  tool(name) {
    const list = $('tool');
    list.value = name ?? list.options[(list.selectedIndex + 1) % list.length].value;
    document.body.dataset.tool = list.value;
  }

  /** Pins the selected object where it is. */
  freeze() { return this.ordered({ action: 'pin' }); }

  thaw() { return this.ordered({ action: 'release' }); }

  /** An order about the selected object. @param {object} order */
  ordered(order) {
    const object = this.object;
    return object && this.page.order({ ...order, object: object.id });
  }

  /** Sliders for the numbers of the chosen preset, on a logarithmic scale where they are large. @param {any} [object] */
  sliders(object) {
    const preset = this.state.about.presets.find((/** @type {any} */ p) => p.name === $('preset').value);
    if (!preset) { $('numbers').replaceChildren(); return; }
    const own = { ...preset.numbers };
    if (object && 'youngs_modulus_pa' in own && object.youngs_modulus > 0) own.youngs_modulus_pa = object.youngs_modulus;
    $('numbers').replaceChildren(...Object.entries(own).map(([key, value]) => {
      const label = document.createElement('label'), slider = document.createElement('input'), out = document.createElement('output');
      const isLarge = preset.numbers[key] > 10;
      Object.assign(slider, { type: 'range', step: 'any' });
      [slider.min, slider.max] = isLarge ? ['-1.5', '1.5'] : ['0', String(key === 'poisson_ratio' ? 0.49 : Math.max(1e-3, 2 * preset.numbers[key]))];
      slider.value = String(isLarge ? Math.log10(value / preset.numbers[key]) : value);
      const number = () => isLarge ? preset.numbers[key] * 10 ** Number(slider.value) : Number(slider.value);
      slider.oninput = () => { slider.dataset.number = String(number()); out.value = short(number()); };
      slider.dataset.key = key;
      slider.dataset.number = String(value);
      out.value = short(value);
      label.append(key.replaceAll('_', ' '), slider, out);
      return label;
    }));
  }

  /** The material that preset and sliders say. */
  material() {
    const material = /** @type {any} */ ({ preset: $('preset').value });
    for (const slider of $('numbers').querySelectorAll('input')) material[slider.dataset.key] = Number(slider.dataset.number);
    return material;
  }

  /** Gives a patch of an object that material. @param {any} object @param {number[]} point [m] @param {number} radius [m] */
  paint(object, point, radius) {
    const material = this.material();
    return this.edits.ordered(`painted with ${material.preset}`, { action: 'set-material', object: object.id, material, point, radius });
  }

  apply() {
    const object = this.object;
    if (!object) return;
    const material = this.material();
    const former = object.material, name = (/** @type {string} */ text) => { object.material = text; };
    const shown = { before: () => name(former), after: () => name(material.preset) };
    return this.edits.ordered(`made of ${material.preset}`, { action: 'set-material', object: object.id, material }, shown);
  }

  /** The preset before or after. @param {number} by */
  preset(by) {
    const list = $('preset');
    list.selectedIndex = (list.selectedIndex + by + list.length) % list.length;
    this.sliders();
    return this.apply();
  }

  gravity() {
    const now = this.state.about.gravity, size = Math.hypot(...now);
    const up = this.page.view().up;
    const gravity = up.map((/** @type {number} */ x, /** @type {number} */ a) => (size > 0 ? now[a] / size : -x) * Number($('g').value));
    const before = this.g, after = Number($('g').value);
    const strength = (/** @type {number} */ value) => { this.g = $('g').value = value; $('g').oninput(); };
    strength(before);
    const shown = { before: () => strength(before), after: () => strength(after) };
    return this.edits.ordered('gravity set', { action: 'gravity', gravity }, shown);
  }

  /** Colour and share of it for an object; a share below 0 hides it. @param {any} object */
  tint(object) {
    if (!isThere(object)) return [0, 0, 0, -1];
    if ($('levels').checked) return [...(LEVELS[/** @type {2} */ (object.figures.fidelity ?? object.fidelity)] ?? LEVELS[1])[1], 0.7];
    return this.state.objects[this.selected] === object && this.page.isMarking() ? [1, 0.85, 0.2, 0.25] : [0, 0, 0, 0];
  }

  show() {
    const state = this.state, figures = state?.figures;
    if (!figures?.status) return;
    const status = figures.status;
    $('pause').textContent = this.isPaused ? 'Resume' : 'Pause';
    state.objects.forEach((/** @type {any} */ object, /** @type {number} */ n) => {
      const level = LEVELS[/** @type {2} */ (object.figures.fidelity ?? 1)] ?? LEVELS[1];
      const text = `${object.material}, ${short(object.figures.mass ?? 0)} kg, ${level[0]}, ${short(object.figures.speed ?? 0)} m/s`;
      $('objects').children[n].lastChild.textContent = text;
    });
    if (state.about.recorded && !this.isSeeking) $('time').value = state.step;
    $('time-out').value = state.about.recorded ? `${state.step} of ${state.about.recorded[1]}` : '';
    this.edits.show();
    this.charts.add(figures);
    const rows = /** @type {Record<string, any>} */ ({
      'substep': `${short(status.dt)} s`, 'real time': `${short(status.real_time)} x`, 'potential energy': `${short(status.potential)} J`,
      'work of hands': `${short(status.spring_work)} J`, 'energy of edits': `${short(status.edit_energy)} J`, 'mass of edits': `${short(status.edit_mass)} kg`,
      'Gaussians': state.about.gaussians, 'particles': state.about.particles, 'left the domain': status.left,
      'quarantined': status.quarantined, 'rolled back': status.rollbacks, 'not shown here': state.dropped,
    });
    if (status.step_seconds > 0) rows['a step takes'] = `${short(status.step_seconds)} s`;
    for (const cost of status.costs) {
      const name = state.objects[cost.id]?.name ?? cost.id;
      const substeps = `${short(cost.substeps)} substeps by ${LIMITS[cost.limit] ?? LIMITS[0]}, ${cost.points} points touch`;
      rows[`time of ${name}`] = `${Math.round(100 * cost.share)} %${cost.dt > 0 ? `, ${substeps}` : ''}`;
    }
    $('figures').replaceChildren(...Object.entries(rows).flatMap(([name, value]) => {
      const [dt, dd] = [document.createElement('dt'), document.createElement('dd')];
      [dt.textContent, dd.textContent] = [name, String(value)];
      return [dt, dd];
    }));
  }
}
