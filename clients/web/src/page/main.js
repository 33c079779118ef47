// @ts-check
// The page: asks for what is newer, draws it, and passes on what a person does.

import * as link from './link.js';
import { State } from './state.js';
import { Camera, fit } from './camera.js';
import { Painter, background } from './draw.js';
import { Panel } from './panel.js';
import { Pointer } from './pointer.js';
import { pick } from './pick.js';

const $ = (/** @type {string} */ id) => /** @type {any} */ (document.getElementById(id));
const canvas = /** @type {HTMLCanvasElement} */ ($('view'));
const FIGURES_MS = 250;
const MARK_MS = 1200;

let state = /** @type {State | null} */ (null);
let camera = /** @type {Camera | null} */ (null);
let isDrawn = false;
let marked = 0;
const page = {
  get state() { return state; },
  get camera() { return camera; },
  get panel() { return panel; },
  /** @param {object} order @param {number} [step] */
  async order(order, step = 0) {
    try {
      const answer = await link.order(order, step);
      say(answer.refused ?? '');
      return answer;
    } catch (error) {
      say(String(/** @type {Error} */ (error).message));
    }
  },
  view: () => ({ ...camera?.look(canvas.width, canvas.height), up: camera?.up }),
  say,
  redraw() { isDrawn = false; },
  changed() { marked = performance.now(); isDrawn = false; setTimeout(() => { isDrawn = false; }, MARK_MS + 20); },
  isMarking: () => performance.now() - marked < MARK_MS,
};

/** @param {string} text */
function say(text) { $('message').textContent = text; }

let painter = /** @type {Painter | null} */ (null);
const told = (/** @type {string} */ words) => { isDrawn = false; say(words); };
try { painter = new Painter(canvas, told); } catch (error) { say(String(/** @type {Error} */ (error).message)); }
const panel = new Panel(page);
const pointer = new Pointer(page, canvas);

async function begin() {
  const about = await link.scene();
  if (!about.objects) return;
  const harmonics = about.sh_degree > 0 ? await link.harmonics() : null;
  state = new State(about);
  camera ??= new Camera(about);
  painter?.begin(state, harmonics);
  panel.begin(state);
}

async function pull() {
  let lastFigures = 0;
  for (;;) {
    try {
      if (!state?.about.objects) await begin();
      const isDue = performance.now() - lastFigures >= FIGURES_MS;
      const answer = await link.frame(state?.about.scene ?? 0, state?.version ?? 0, isDue ? state?.figuresAt ?? 0 : null);
      if (!state) continue;
      const { scene, moved } = state.take(answer);
      if (scene !== state.about.scene) {
        await begin();
        continue;
      }
      if (isDue) {
        lastFigures = performance.now();
        panel.show();
        const ended = state.figures && !state.figures.alive ? 'the server has ended, or does not answer' : '';
        if (ended || $('message').textContent.startsWith('the server')) say(ended);
        if ($('levels').checked) isDrawn = false;
      }
      if (moved) {
        isDrawn = false;
        // One frame is drawn before the next is asked for: a slow page gets fewer, and no queue.
        await drawn();
      }
    } catch (error) {
      say(`the server does not answer: ${/** @type {Error} */ (error).message}`);
      await new Promise((next) => setTimeout(next, 1000));
    }
  }
}

/** Waits until what has come is drawn; where nothing is, as in a hidden tab, for a while. */
async function drawn() {
  const until = performance.now() + FIGURES_MS;
  while (!isDrawn && performance.now() < until) {
    await Promise.race([new Promise(requestAnimationFrame), new Promise((next) => setTimeout(next, FIGURES_MS))]);
  }
}

function draw() {
  requestAnimationFrame(draw);
  if (!state || !camera || !painter) return;
  if (fit(canvas)) isDrawn = false;
  const age = state.age + performance.now() - state.arrived;
  $('clock').textContent = `${state.time.toFixed(2)} s, step ${state.step}, ${panel.isPaused ? 'paused' : `${age.toFixed(0)} ms old`}`;
  if (isDrawn || painter.isBusy) return;
  isDrawn = true;
  state.fill((object) => panel.tint(object));
  painter.draw(camera.look(canvas.width, canvas.height), background());
  if (pointer.hold) pointer.mark();
  pictures++;
}

let pictures = 0;

// Keys.
/** @type {Record<string, () => unknown>} */
const keys = {
  ' ': () => panel.pause(), '.': () => panel.step(), r: () => panel.reset(), ',': () => panel.seek((state?.step ?? 0) - 1),
  n: () => panel.select(panel.selected + 1), N: () => panel.select(panel.selected - 1),
  j: () => panel.push('left'), k: () => panel.push('right'), i: () => panel.push('up'), m: () => panel.push('down'),
  '[': () => panel.preset(-1), ']': () => panel.preset(1),
  '+': () => camera?.zoom(0.9), '=': () => camera?.zoom(0.9), '-': () => camera?.zoom(1 / 0.9), 0: () => camera?.reset(),
  l: () => $('levels').click(), p: () => keepPicture(), h: () => panel.tool(), f: () => panel.freeze(), F: () => panel.thaw(),
  Delete: () => panel.edits.remove(), b: () => panel.edits.bringIn(), u: () => panel.edits.undo(), U: () => panel.edits.redo(), '?': () => $('help').showModal(),
};
/** What gives orders. */
const orders = [...' .,rjkimfF[]buU', 'Delete'];
const arrows = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] });
window.addEventListener('keydown', (event) => {
  const target = /** @type {HTMLElement} */ (event.target);
  const isUndo = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 'z';
  if (((event.ctrlKey || event.metaKey) && !isUndo) || event.altKey || ['INPUT', 'SELECT'].includes(target.tagName) || $('help').open) return;
  if (target.tagName === 'BUTTON' && event.key === ' ') return;
  const arrow = arrows[event.key], key = isUndo ? keys[event.shiftKey ? 'U' : 'u'] : keys[event.key];
  if (arrow && camera) {
    if (event.shiftKey) camera.shift(-0.05 * arrow[0], 0.05 * arrow[1]);
    else camera.turn(0.1 * arrow[0], 0.1 * arrow[1]);
  } else if (key && !(state?.about.read_only && (isUndo || orders.includes(event.key)))) {
    key();
  } else return;
  event.preventDefault();
  isDrawn = false;
});

// What a person keeps.
/** @param {Blob} blob @param {string} name */
function keep(blob, name) {
  const anchor = document.createElement('a');
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10000);
}
const keepPicture = () => canvas.toBlob((blob) => { if (blob) keep(blob, `cosplat-${state?.step ?? 0}.png`); });
$('picture').onclick = keepPicture;

let recorder = /** @type {MediaRecorder | null} */ (null);
$('video').onclick = () => {
  if (recorder) return recorder.stop();
  const parts = /** @type {Blob[]} */ ([]);
  try { recorder = new MediaRecorder(canvas.captureStream(30)); } catch { return say('this browser records no video'); }
  recorder.ondataavailable = (event) => parts.push(event.data);
  recorder.onstop = () => {
    const kind = recorder?.mimeType ?? 'video/webm';
    keep(new Blob(parts, { type: kind }), `cosplat.${kind.includes('mp4') ? 'mp4' : 'webm'}`);
    recorder = null;
    $('video').textContent = 'Start video';
  };
  recorder.start(1000);
  $('video').textContent = 'Stop video';
};
const theme = (/** @type {boolean} */ isDark) => {
  document.documentElement.classList.toggle('dark', isDark);
  $('theme').textContent = isDark ? 'Light' : 'Dark';
  isDrawn = false;
};
$('theme').onclick = () => theme(!document.documentElement.classList.contains('dark'));
theme(matchMedia('(prefers-color-scheme: dark)').matches);
const fold = (/** @type {boolean} */ isOpen) => {
  $('panel').hidden = !isOpen;
  document.body.classList.toggle('open', isOpen);
  $('more').setAttribute('aria-expanded', String(isOpen));
};
$('more').onclick = () => fold($('panel').hidden);
fold(window.innerWidth > 700);
$('help-button').onclick = () => $('help').showModal();

// For tests and the console.
Object.assign(window, { cosplat: { get state() { return state; }, get camera() { return camera; }, panel, pointer,
  pick: (/** @type {number} */ x, /** @type {number} */ y) => state && pick(state, page.view(), x, y), get pictures() { return pictures; },
  get isCurrent() { return isDrawn && !painter?.isBusy && !page.isMarking(); } } });
canvas.focus();
pull();
draw();
