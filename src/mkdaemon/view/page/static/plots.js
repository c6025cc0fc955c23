// Plots that scroll: values over the last seconds, drawn on a canvas.

const WINDOW = 30; // seconds shown
const GAP = 1.5; // a line is broken where nothing came for so long [s]
const KEPT = 4096; // points kept of a series

/** Curves of one quantity. */
export class Plot {
  /**
   * @param {HTMLElement} parent where it stands
   * @param {{id: string, title: string, unit: string, least: number, lines: Array}} about least: smallest span shown
   */
  constructor(parent, about) {
    this.about = about;
    this.box = document.createElement("div");
    this.box.className = "plot";
    this.box.title = about.hint || "";
    this.box.dataset.plot = about.id;
    this.head = document.createElement("h2");
    this.canvas = document.createElement("canvas");
    this.box.append(this.head, this.canvas);
    parent.append(this.box);
    this.head.append(`${about.title} [${about.unit}]`);
    for (const line of about.lines.filter((one) => one.name)) {
      line.label = document.createElement("span");
      line.label.dataset.curve = line.name;
      this.head.append(line.label);
    }
  }

  /**
   * Draw.
   * @param {Object<string, number[][]>} series points by name: time, then values
   * @param {number} now end of the time shown [s]
   */
  draw(series, now) {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim();
    const scale = window.devicePixelRatio || 1;
    const wide = this.canvas.clientWidth, tall = this.canvas.clientHeight;
    if (this.canvas.width !== Math.round(wide * scale) || this.canvas.height !== Math.round(tall * scale)) {
      this.canvas.width = Math.round(wide * scale);
      this.canvas.height = Math.round(tall * scale);
    }
    const pen = this.canvas.getContext("2d");
    pen.setTransform(scale, 0, 0, scale, 0, 0);
    pen.clearRect(0, 0, wide, tall);
    const curves = this.about.lines.map((line) => visible(series[line.series] || [], line.column, now));
    const [low, high] = span(curves, this.about.least);
    const left = 38, right = wide - 6, top = 6, bottom = tall - 16;
    const x = (t) => right - (now - t) / WINDOW * (right - left);
    const y = (v) => bottom - (v - low) / (high - low) * (bottom - top);
    pen.font = "11px system-ui, 'DejaVu Sans', sans-serif";
    pen.fillStyle = colour("--soft");
    pen.strokeStyle = colour("--rule");
    pen.textAlign = "right";
    for (const tick of ticks(low, high)) {
      pen.beginPath(); pen.moveTo(left, y(tick)); pen.lineTo(right, y(tick)); pen.stroke();
      pen.fillText(String(+tick.toPrecision(6)), left - 4, y(tick) + 4);
    }
    pen.textAlign = "center";
    for (let back = 0; back <= WINDOW; back += 10) pen.fillText(back ? `-${back} s` : "", x(now - back), tall - 3);
    pen.save();
    pen.beginPath(); pen.rect(left, 0, right - left, bottom + 1); pen.clip();
    this.about.lines.forEach((line, k) => {
      pen.strokeStyle = colour(line.colour);
      pen.globalAlpha = line.dashed ? 0.6 : 1;
      pen.lineWidth = line.dashed ? 1 : 1.6;
      pen.setLineDash(line.dashed ? [4, 3] : []);
      pen.beginPath();
      let before = -Infinity;
      for (const [t, v] of curves[k]) {
        if (t - before > GAP) pen.moveTo(x(t), y(v)); else pen.lineTo(x(t), y(v));
        before = t;
      }
      pen.stroke();
      if (line.label) {
        const last = curves[k].at(-1);
        const isOld = !last || now - last[0] > GAP;
        line.label.textContent = `${line.name} ${isOld ? "–" : last[1].toFixed(this.about.digits)}`;
        line.label.style.color = colour(line.colour);
      }
    });
    pen.restore();
  }
}

/** Add points to a series and forget the oldest. */
export function extend(kept, points) {
  kept.push(...points);
  if (kept.length > KEPT) kept.splice(0, kept.length - KEPT);
}

function visible(points, column, now) {
  const found = [];
  for (let k = points.length - 1; k >= 0 && points[k][0] > now - WINDOW; k--) {
    const value = points[k][column];
    if (value !== null && value !== undefined) found.push([points[k][0], value]);
  }
  return found.reverse();
}

function span(curves, least) {
  let low = Infinity, high = -Infinity;
  for (const curve of curves) for (const [, v] of curve) { low = Math.min(low, v); high = Math.max(high, v); }
  if (low > high) [low, high] = [0, least];
  const lack = least - (high - low);
  if (lack > 0) { low -= low >= 0 && low < lack / 2 ? low : lack / 2; high = low + least; }
  const room = (high - low) * 0.08;
  return [low - room, high + room];
}

function ticks(low, high) {
  const raw = (high - low) / 4, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => one >= raw);
  const found = [];
  for (let tick = Math.ceil(low / step) * step; tick <= high; tick += step) found.push(tick);
  return found;
}
