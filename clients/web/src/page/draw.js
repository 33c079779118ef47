// @ts-check
// Sorts the Gaussians by depth and blends them, farthest first.

import { WIDTH, ROW } from './state.js';
import { vertex, fragment } from './shaders.js';

const KEYS = 65536;
const LOST = 'the browser lost its graphics: the picture comes back with them';

/** What is behind all Gaussians, 0..1. */
export const background = () => document.documentElement.classList.contains('dark') ? [0.1, 0.1, 0.1] : [0.93, 0.93, 0.93];

export class Painter {
  /** @param {HTMLCanvasElement} canvas @param {(words: string) => void} told when the picture is lost, and when it is to be drawn again */
  constructor(canvas, told) {
    const gl = canvas.getContext('webgl2', { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error('this browser has no WebGL2, which the page draws with');
    this.gl = gl;
    this.counts = new Uint32Array(KEYS);
    this.state = /** @type {import('./state.js').State | null} */ (null);
    this.harmonics = /** @type {ArrayBuffer | null} */ (null);
    this.prepare();
    canvas.addEventListener('webglcontextlost', (event) => {
      // Without this the browser never gives it back.
      event.preventDefault();
      told(LOST);
    });
    canvas.addEventListener('webglcontextrestored', () => {
      this.prepare();
      if (this.state) {
        this.begin(this.state, this.harmonics);
        this.state.dirty = { rows: [[0, this.state.rows]], paint: true };
      }
      told('');
    });
  }

  /** Forgets all that a lost context had. */
  prepare() {
    const gl = this.gl;
    // Sums of many faint layers want more than 8 bits.
    this.isFine = gl.getExtension('EXT_color_buffer_float') !== null;
    this.size = [0, 0];
    this.fence = /** @type {WebGLSync | null} */ (null);
    this.textures = /** @type {WebGLTexture[]} */ ([]);
    this.fine = /** @type {WebGLTexture | null} */ (null);
    this.copier = /** @type {WebGLProgram | null} */ (null);
    this.frame = /** @type {WebGLFramebuffer | null} */ (null);
  }

  /** @param {import('./state.js').State} state @param {ArrayBuffer | null} harmonics */
  begin(state, harmonics) {
    const gl = this.gl, degree = state.about.sh_degree;
    [this.state, this.harmonics] = [state, harmonics];
    // All is made once there is a context again.
    if (gl.isContextLost()) return;
    this.program = program(gl, vertex(degree), fragment);
    this.at = (/** @type {string} */ name) => gl.getUniformLocation(/** @type {WebGLProgram} */ (this.program), name);
    for (const former of this.textures) gl.deleteTexture(former);
    this.textures = ['packed', 'paint', 'table', 'turns', 'harmonics'].map(() => gl.createTexture());
    this.storage(0, gl.RGBA32UI, WIDTH, state.rows);
    this.storage(1, gl.RG32UI, WIDTH, state.rows);
    this.storage(2, gl.RGBA32F, ROW / 4, Math.max(1, state.objects.length));
    this.storage(3, gl.R32UI, WIDTH, state.turns ? state.rows : 1);
    const texels = harmonics ? harmonics.byteLength / 16 : 1, rows = Math.max(1, Math.ceil(texels / WIDTH));
    this.storage(4, gl.RGBA32UI, WIDTH, rows);
    if (harmonics) {
      const whole = new Uint32Array(rows * WIDTH * 4);
      whole.set(new Uint32Array(harmonics));
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, rows, gl.RGBA_INTEGER, gl.UNSIGNED_INT, whole);
    }
    this.order = new Uint32Array(state.count);
    this.keys = new Uint32Array(state.count);
    this.depths = new Float32Array(state.count);
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * Math.max(1, state.count), gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
  }

  /** @param {number} n @param {number} format @param {number} width @param {number} height */
  storage(n, format, width, height) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + n);
    gl.bindTexture(gl.TEXTURE_2D, this.textures[n]);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  }

  upload() {
    const gl = this.gl, state = this.state;
    if (!state) return;
    for (const [from, to] of state.dirty.rows) {
      gl.activeTexture(gl.TEXTURE0);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from, WIDTH, to - from, gl.RGBA_INTEGER, gl.UNSIGNED_INT, state.packed, from * WIDTH * 4);
      if (state.turns) {
        gl.activeTexture(gl.TEXTURE3);
        gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from, WIDTH, to - from, gl.RED_INTEGER, gl.UNSIGNED_INT, state.turns, from * WIDTH);
      }
    }
    if (state.dirty.paint) {
      gl.activeTexture(gl.TEXTURE1);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, state.rows, gl.RG_INTEGER, gl.UNSIGNED_INT, state.paint);
    }
    state.dirty = { rows: [], paint: false };
    gl.activeTexture(gl.TEXTURE2);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW / 4, Math.max(1, state.objects.length), gl.RGBA, gl.FLOAT, state.table);
  }

  /** Indices of what is before the camera, farthest first; says how many. @param {any} view */
  sort(view) {
    const { state, keys, depths, order, counts } = this;
    if (!state || !keys || !depths || !order) return 0;
    const { packed, table } = state, f = view.forward;
    let low = Infinity, high = -Infinity, seen = 0;
    state.objects.forEach((/** @type {any} */ object, /** @type {number} */ n) => {
      const t = table.subarray(n * ROW, n * ROW + ROW);
      const column = (/** @type {number} */ a) => f[0] * t[8 + a] + f[1] * t[12 + a] + f[2] * t[16 + a];
      const d = [column(0), column(1), column(2)];
      const [x, y, z] = [d[0] * t[4], d[1] * t[5], d[2] * t[6]];
      const start = d[0] * t[0] + d[1] * t[1] + d[2] * t[2] + f[0] * (t[11] - view.position[0])
        + f[1] * (t[15] - view.position[1]) + f[2] * (t[19] - view.position[2]);
      for (let i = object.first, end = object.first + object.count; i < end; i++) {
        const w0 = packed[4 * i], w1 = packed[4 * i + 1];
        const depth = start + x * (w0 & 65535) + y * (w0 >>> 16) + z * (w1 & 65535);
        if (!(depth >= view.near) || (w1 & 0xff0000) === 0) continue;
        if (depth < low) low = depth;
        if (depth > high) high = depth;
        keys[seen] = i;
        depths[seen++] = depth;
      }
    });
    counts.fill(0);
    const scale = high > low ? (KEYS - 1) / (high - low) : 0;
    for (let n = 0; n < seen; n++) counts[((high - depths[n]) * scale) | 0]++;
    for (let k = 0, total = 0; k < KEYS; k++) {
      const own = counts[k];
      counts[k] = total;
      total += own;
    }
    for (let n = 0; n < seen; n++) order[counts[((high - depths[n]) * scale) | 0]++] = keys[n];
    return seen;
  }

  /** Whether the picture before is still being drawn, or nothing can be: another would wait behind it. */
  get isBusy() {
    const gl = this.gl;
    if (gl.isContextLost()) return true;
    if (!this.fence) return false;
    const state = gl.clientWaitSync(this.fence, 0, 0);
    if (state === gl.TIMEOUT_EXPIRED) return true;
    gl.deleteSync(this.fence);
    this.fence = null;
    return false;
  }

  /** Draws the scene. @param {any} view @param {number[]} background 0..1 */
  draw(view, background) {
    const gl = this.gl, at = this.at;
    if (!at || !this.program || !this.order) return;
    this.upload();
    const seen = this.sort(view);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, this.order, 0, seen);
    if (this.isFine) this.target(view.width, view.height);
    gl.viewport(0, 0, view.width, view.height);
    gl.clearColor(background[0], background[1], background[2], 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.useProgram(this.program);
    ['packed', 'paint', 'table', 'turns', 'harmonics'].forEach((name, n) => gl.uniform1i(at(name), n));
    gl.uniformMatrix3fv(at('axes'), false, [...view.right, ...view.down, ...view.forward]);
    gl.uniform3fv(at('eye'), view.position);
    gl.uniform2f(at('size'), view.width, view.height);
    gl.uniform1f(at('focal'), view.focal);
    gl.uniform1f(at('near'), view.near);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.ONE, gl.ONE_MINUS_SRC_ALPHA, gl.ZERO, gl.ONE);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, seen);
    if (this.isFine) this.copy();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
  }

  /** A picture with more than 8 bits. @param {number} width @param {number} height */
  target(width, height) {
    const gl = this.gl;
    if (this.size[0] !== width || this.size[1] !== height) {
      this.size = [width, height];
      gl.deleteTexture(this.fine);
      this.fine = gl.createTexture();
      this.copier ??= program(gl, COPY_VERTEX, COPY_FRAGMENT);
      this.frame ??= gl.createFramebuffer();
      gl.activeTexture(gl.TEXTURE5);
      gl.bindTexture(gl.TEXTURE_2D, this.fine);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, width, height);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.fine, 0);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
  }

  copy() {
    const gl = this.gl, copier = /** @type {WebGLProgram} */ (this.copier);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.BLEND);
    gl.useProgram(copier);
    gl.uniform1i(gl.getUniformLocation(copier, 'fine'), 5);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

const COPY_VERTEX = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
const COPY_FRAGMENT = `#version 300 es
precision highp float;
uniform highp sampler2D fine;
out vec4 light;
void main() { light = vec4(texelFetch(fine, ivec2(gl_FragCoord.xy), 0).rgb, 1.0); }`;

/** @param {WebGL2RenderingContext} gl @param {string} vertexText @param {string} fragmentText */
function program(gl, vertexText, fragmentText) {
  const made = /** @type {WebGLProgram} */ (gl.createProgram());
  for (const [kind, text] of /** @type {[number, string][]} */ ([[gl.VERTEX_SHADER, vertexText], [gl.FRAGMENT_SHADER, fragmentText]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? 'a shader fails');
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made) ?? 'the shaders do not fit');
  return made;
}
