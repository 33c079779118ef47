// @ts-check
// The page of `cosplat objects pick --web`: strokes over a splat, the objects that come of them in colours, and their file.

import * as link from './link.js';
import { Camera, fit, steer } from './camera.js';
import { Painter, background } from './draw.js';
import { centre, pick, pixelOf } from './pick.js';
import { State } from './state.js';

const $ = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const canvas = /** @type {HTMLCanvasElement} */ ($('view'));
/** Objects whose colours the table has room for; more begin again with the first. */
const MOST = 256;
/** Share of an object's colour in what is drawn. */
const SHARE = 0.65;
/** Distance of the points of a line [pixel]. */
const STEP = 3;

/** @typedef {{ name: string, gaussians: number[] }} Stroke */
let state = /** @type {State | null} */ (null);
let camera = /** @type {Camera | null} */ (null);
let painter = /** @type {Painter | null} */ (null);
let isDrawn = false;
let strokes = /** @type {Stroke[]} */ ([]);
let undone = /** @type {Stroke[]} */ ([]);
let objects = /** @type {{ name: string, color: number[], gaussians: number }[]} */ ([]);
/** Points of the line that is being drawn [pixel]. */
let line = /** @type {number[][] | null} */ (null);
/** Questions that wait for those before them. */
let queue = Promise.resolve();
let asking = 0;
let isSaved = true;

const say = (/** @type {string} */ text) => { $('message').textContent = text; };
const view = () => /** @type {Camera} */ (camera).look(canvas.width, canvas.height);

/** Asks one thing after the other; `then` takes the answer. @param {() => object} asked @param {(told: any) => void} then */
function ask(asked, then) {
  asking++;
  say('...');
  queue = queue.then(async () => {
    try {
      const told = await link.strokes(asked());
      say('');
      then(told);
      take(told);
    } catch (error) {
      say(/** @type {Error} */ (error).message);
    }
    asking--;
    show();
  });
  return queue;
}

/** Takes over the objects of an answer. @param {any} told */
function take(told) {
  if (!state) return;
  objects = told.objects;
  for (let n = 0; n < state.count; n++) state.paint[2 * n + 1] = told.label[n] < 0 ? 0 : 1 + (told.label[n] % MOST);
  state.dirty.paint = true;
  isDrawn = false;
}

/** A name that no object and no stroke has. */
function fresh() {
  const taken = new Set([...objects, ...strokes].map((one) => one.name));
  let n = 1;
  while (taken.has(`thing_${n}`)) n++;
  return `thing_${n}`;
}

/** Asks for the objects of these strokes in place of those that there are; a refusal changes nothing.
 * @param {(own: Stroke[]) => Stroke[]} change @param {() => void} [then] */
function change(change, then = () => {}) {
  let wanted = strokes;
  return ask(() => ({ strokes: wanted = change(strokes) }), () => {
    strokes = wanted;
    isSaved = false;
    then();
  });
}

/** @param {number[][]} points [pixel] */
function stroke(points) {
  const name = $('name').value.trim(), { position, right, down, forward, focal, near, width, height } = view();
  const drawn = { name, position, axes: [right, down, forward], focal, size: [width, height], near, points };
  return ask(() => ({ strokes, line: drawn }), (told) => {
    strokes = [...strokes, { name, gaussians: told.line }];
    undone = [];
    isSaved = false;
  });
}

function undo() {
  const last = strokes[strokes.length - 1];
  if (last && !asking) change((own) => own.slice(0, -1), () => undone.push(last));
}
function redo() {
  const last = undone[undone.length - 1];
  if (last && !asking) change((own) => [...own, last], () => undone.pop());
}
const save = () => ask(() => ({ strokes, save: true }), (told) => {
  isSaved = true;
  setTimeout(() => say(`${told.objects.length} objects saved in ${told.saved}`));
});
function rename() {
  const item = $('objects').querySelector('[aria-selected=true]'), former = item?.dataset.name, name = $('name').value.trim();
  if (!former || former === name) return;
  if (!strokes.some((one) => one.name === former)) return say(`${former} has no stroke: click it to give it the name ${name}`);
  change((own) => own.map((one) => (one.name === former ? { ...one, name } : one)));
}

/** The list, and what can be done. */
function show() {
  const name = $('name').value.trim();
  $('objects').replaceChildren(...objects.map((object) => {
    const item = document.createElement('li'), mark = document.createElement('i'), small = document.createElement('small');
    item.setAttribute('role', 'option');
    item.setAttribute('aria-selected', String(object.name === name));
    item.dataset.name = object.name;
    item.onclick = () => { $('name').value = object.name; show(); };
    mark.style.background = css(object.color);
    const count = strokes.filter((one) => one.name === object.name).length;
    small.textContent = `${object.gaussians} Gaussians, ${count === 1 ? '1 stroke' : count ? `${count} strokes` : 'whole'}`;
    item.append(mark, object.name, small);
    return item;
  }));
  $('undo').disabled = !strokes.length;
  $('redo').disabled = !undone.length;
  $('clock').textContent = isSaved ? '' : 'not saved';
}

const css = (/** @type {number[]} */ color) => `rgb(${color.map((x) => Math.round(255 * x)).join(' ')})`;
const colourOf = (/** @type {string} */ name) => css(objects.find((one) => one.name === name)?.color ?? [0.2, 0.5, 1]);

const model = $('strokes').firstElementChild;

/** Draws the strokes where their Gaussians are seen, and the line so far. */
function mark() {
  if (!state) return;
  const scale = canvas.clientWidth / canvas.width, seen = view(), whole = state.objects[0];
  const lines = strokes.map(({ name, gaussians }) => {
    const places = gaussians.map((n) => centre(/** @type {State} */ (state), whole, n));
    const front = places.filter((p) => p.reduce((s, x, a) => s + (x - seen.position[a]) * seen.forward[a], 0) > seen.near);
    return /** @type {[string, number[][]]} */ ([colourOf(name), front.map((p) => pixelOf(seen, p))]);
  });
  if (line) lines.push([colourOf($('name').value.trim()), line]);
  $('strokes').replaceChildren(...lines.filter(([, points]) => points.length).map(([color, points]) => {
    const shape = /** @type {Element} */ (model.cloneNode());
    const all = points.length > 1 ? points : [points[0], points[0]];
    shape.setAttribute('points', all.map(([x, y]) => `${x * scale},${y * scale}`).join(' '));
    shape.setAttribute('stroke', color);
    return shape;
  }));
}

function draw() {
  requestAnimationFrame(draw);
  if (!state || !camera || !painter) return;
  if (fit(canvas)) isDrawn = false;
  if (isDrawn || painter.isBusy) return;
  isDrawn = true;
  const share = $('colours').checked ? SHARE : 0;
  state.fill((object) => {
    const own = objects[object.id - 1];
    return own ? [...own.color, share] : [0, 0, 0, 0];
  });
  painter.draw(view(), background());
  mark();
}

// Mouse and touch.
const fingers = /** @type {Map<number, number[]>} */ (new Map());
/** Where an event is in the picture, in the middle of a pixel. @param {MouseEvent} event */
const at = (event) => {
  const scale = canvas.width / canvas.clientWidth;
  return [[event.clientX, canvas.width], [event.clientY, canvas.height]].map(([x, most]) => Math.min(most, Math.max(0, Math.floor(x * scale) + 0.5)));
};
canvas.addEventListener('contextmenu', (event) => event.preventDefault());
canvas.addEventListener('pointerdown', (event) => {
  canvas.setPointerCapture(event.pointerId);
  canvas.focus();
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  if (fingers.size > 1) line = null;
  else if (state && event.button === 0 && !event.shiftKey && $('tool').value === 'stroke') {
    const point = at(event);
    if (pick(state, view(), point[0], point[1])) line = [point];
  }
  mark();
});
canvas.addEventListener('pointermove', (event) => {
  if (!camera || !fingers.has(event.pointerId)) return;
  if (line) {
    const point = at(event), last = line[line.length - 1];
    if (Math.hypot(point[0] - last[0], point[1] - last[1]) >= STEP) line.push(point);
    mark();
  } else {
    steer(camera, fingers, event, canvas.clientHeight);
    isDrawn = false;
  }
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const end of ['pointerup', 'pointercancel']) {
  canvas.addEventListener(end, (event) => {
    fingers.delete(/** @type {PointerEvent} */ (event).pointerId);
    if (line && end === 'pointerup') stroke(line);
    line = null;
    mark();
  });
}
canvas.addEventListener('wheel', (event) => {
  event.preventDefault();
  camera?.zoom(Math.exp(event.deltaY * 0.001));
  isDrawn = false;
}, { passive: false });

// Keys and buttons.
const tool = (/** @type {string} */ name) => { $('tool').value = document.body.dataset.tool = name; };
/** @type {Record<string, () => unknown>} */
const keys = {
  '+': () => camera?.zoom(0.9), '=': () => camera?.zoom(0.9), '-': () => camera?.zoom(1 / 0.9), 0: () => camera?.reset(),
  u: undo, U: redo, s: save, l: () => $('colours').click(), n: () => $('new').click(),
  h: () => tool($('tool').value === 'stroke' ? 'turn' : 'stroke'), '?': () => $('help').showModal(),
};
const arrows = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] });
window.addEventListener('keydown', (event) => {
  const target = /** @type {HTMLElement} */ (event.target);
  const isUndo = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 'z';
  const isTyped = target.tagName === 'SELECT' || /** @type {HTMLInputElement} */ (target).type === 'text';
  if (((event.ctrlKey || event.metaKey) && !isUndo) || event.altKey || isTyped || $('help').open) return;
  const arrow = arrows[event.key], key = isUndo ? keys[event.shiftKey ? 'U' : 'u'] : keys[event.key];
  if (arrow && camera) {
    if (event.shiftKey) camera.shift(-0.05 * arrow[0], 0.05 * arrow[1]);
    else camera.turn(0.1 * arrow[0], 0.1 * arrow[1]);
  } else if (key) key();
  else return;
  event.preventDefault();
  isDrawn = false;
});
$('undo').onclick = undo;
$('redo').onclick = redo;
$('save').onclick = save;
$('rename').onclick = rename;
$('new').onclick = () => { $('name').value = fresh(); show(); };
$('name').oninput = show;
$('colours').onchange = () => { isDrawn = false; };
$('tool').onchange = () => tool($('tool').value);
$('help-button').onclick = () => $('help').showModal();
tool('stroke');
document.documentElement.classList.toggle('dark', matchMedia('(prefers-color-scheme: dark)').matches);

async function begin() {
  painter = new Painter(canvas, (words) => { isDrawn = false; say(words); });
  const about = await link.scene();
  document.title = `cosplat: ${about.session}`;
  // A row of the table for the colour of each object, with the box of the whole splat and no Gaussians of its own.
  const rows = Array.from({ length: MOST }, (_, n) => ({ id: n + 1, name: '', first: 0, count: 0 }));
  const made = new State({ ...about, objects: [...about.objects, ...rows] });
  const harmonics = about.sh_degree > 0 ? await link.harmonics() : null;
  made.take(await link.frame(about.scene, 0, null));
  const [{ low, extent }] = made.objects;
  for (const row of made.objects) Object.assign(row, { low, extent });
  camera = new Camera(about);
  painter.begin(made, harmonics);
  state = made;
  await ask(() => ({}), () => {});
  $('new').click();
}

// For tests and the console.
Object.assign(window, { cosplat: { get state() { return state; }, get strokes() { return strokes; }, get objects() { return objects; }, view,
  pixelOf: (/** @type {number[]} */ point) => pixelOf(view(), point), get isCurrent() { return isDrawn && !asking && !painter?.isBusy; } } });
canvas.focus();
begin().catch((error) => say(error.message));
draw();
