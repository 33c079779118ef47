// @ts-check
// The time line: a few seconds of each figure.

const KEPT = 240;

export class Charts {
  /** @param {HTMLElement} parent @param {[string, string, (figures: any) => number][]} lines */
  constructor(parent, lines) {
    this.charts = lines.map(([name, unit, value]) => {
      const canvas = document.createElement('canvas');
      canvas.setAttribute('role', 'img');
      parent.append(canvas);
      return { name, unit, value, canvas, values: /** @type {number[]} */ ([]) };
    });
  }

  /** @param {any} figures */
  add(figures) {
    const style = getComputedStyle(document.documentElement);
    for (const chart of this.charts) {
      const { canvas, values } = chart;
      values.push(chart.value(figures));
      if (values.length > KEPT) values.shift();
      const width = (canvas.width = 2 * canvas.clientWidth), height = (canvas.height = 2 * canvas.clientHeight);
      const pen = canvas.getContext('2d');
      if (!pen || !width) continue;
      const top = Math.max(...values, 1e-12), bottom = Math.min(...values, 0);
      pen.strokeStyle = style.getPropertyValue('--mark');
      pen.fillStyle = style.getPropertyValue('--ink');
      pen.lineWidth = 2;
      pen.beginPath();
      values.forEach((v, n) => pen.lineTo((n / (KEPT - 1)) * width, height - 4 - ((v - bottom) / (top - bottom)) * (height - 34)));
      pen.stroke();
      pen.font = '22px system-ui, sans-serif';
      const text = `${chart.name} ${short(values[values.length - 1])} ${chart.unit}`;
      pen.fillText(text, 2, 22);
      canvas.setAttribute('aria-label', text);
    }
  }
}

/** Three digits. @param {number} value */
export const short = (value) => Number.isFinite(value) ? String(Number(value.toPrecision(3))) : '-';
