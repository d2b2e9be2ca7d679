// The page's data as numbers, and what can be told of an instant.
"use strict";
const NO_NUMBER = -32768;
function bytes(text) {
  const raw = atob(text), out = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
  return out.buffer;
}
function unscaled([greatest, text]) {
  const counts = new Int16Array(bytes(text)), out = new Float64Array(counts.length);
  for (let i = 0; i < counts.length; i++) out[i] = counts[i] === NO_NUMBER ? NaN : counts[i] * greatest / 32767;
  return out;
}
class Relay {
  constructor(data, page) {
    Object.assign(this, data);
    this.page = page;
    this.t = new Float64Array(bytes(data.t));
    this.samples = data.samples.map(unscaled);
    this.phasors = new Float32Array(bytes(data.phasors));
    this.impedances = new Float32Array(bytes(data.impedances));
    this.remembered = data.dynamic ? new Float32Array(bytes(data.dynamic.rows)) : null;
    this.shown = data.loop ? data.loop[0] : "AG";
    this.distance = 1; // of the R-X plane
  }
  // Index of the sample nearest to a time, -1 where there is none.
  at(ms) {
    const t = this.t;
    if (!t.length || !(ms >= t[0] - 1e6)) return -1;
    let low = 0, high = t.length - 1;
    while (high - low > 1) { const mid = (low + high) >> 1; if (t[mid] < ms) low = mid; else high = mid; }
    return ms - t[low] < t[high] - ms ? low : high;
  }
  // Row of the estimates at or before a sample, -1 outside the detail.
  row(index) {
    const [first, end] = this.detail;
    return index < first || index >= end ? -1 : Math.floor((index - first) / this.step);
  }
  phasor(row, k) { return row < 0 ? [NaN, NaN] : [this.phasors[12 * row + 2 * k], this.phasors[12 * row + 2 * k + 1]]; }
  impedance(row, k) { return row < 0 ? [NaN, NaN] : [this.impedances[12 * row + 2 * k], this.impedances[12 * row + 2 * k + 1]]; }
  // Zero, positive and negative sequence of voltages (0) or currents (3).
  sequence(row, from) {
    const [a, b, c] = [0, 1, 2].map((k) => this.phasor(row, from + k)), h = Math.sqrt(3) / 2;
    const turned = ([x, y], sign) => [-x / 2 - sign * h * y, -y / 2 + sign * h * x];
    const sum = (...all) => [all.reduce((s, z) => s + z[0], 0) / 3, all.reduce((s, z) => s + z[1], 0) / 3];
    return [sum(a, b, c), sum(a, turned(b, 1), turned(c, -1)), sum(a, turned(b, -1), turned(c, 1))];
  }
  get rows() { return this.phasors.length / 12; }
  // What a primary value is multiplied by to be shown.
  factor(kind) {
    if (!this.page.secondary || !this.ratios) return 1;
    const [ct, vt] = this.ratios;
    return kind === "V" ? 1 / vt : kind === "I" ? 1 / ct : ct / vt;
  }
  // The unit of a voltage or current, and what a primary value is multiplied by for it.
  unit(kind) {
    const secondary = this.page.secondary && this.ratios, small = kind === "V" ? "V" : "A";
    return secondary ? [small, this.factor(kind)] : ["k" + small, 1e-3];
  }
  // Whether a channel has any number.
  has(kind) { return [0, 1, 2].some((k) => this.samples[k + (kind === "V" ? 0 : 3)].some((y) => !Number.isNaN(y))); }
}
const NOTHING = { V: "no voltages in this log", I: "no currents in this log" };
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const magnitude = ([x, y]) => Math.hypot(x, y);
const degrees = ([x, y]) => Math.atan2(y, x) * 180 / Math.PI;
const wrapped = (angle) => ((angle + 540) % 360 + 360) % 360 - 180;
function text(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e6 || size < 1e-4) return value.toExponential(2);
  return value.toFixed(Math.max(0, Math.min(digits, digits - 1 - Math.floor(Math.log10(size)))));
}
