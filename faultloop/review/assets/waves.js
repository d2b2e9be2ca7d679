// Waves and digital lanes of one relay over one time axis (uPlot), with two cursors.
"use strict";
const NARROW = () => window.innerWidth < 600;
const LANES = () => (NARROW() ? 3 : 2); // of labels of marks
const LABELS = () => `${NARROW() ? 10 : 12}px system-ui, sans-serif`;
const FONT = "12px system-ui, sans-serif";
const PHASES = ["A", "B", "C"];

// Room for the lanes' names, the same in all plots of a relay.
function axisWidth(relay) {
  const g = (axisWidth.canvas ||= document.createElement("canvas")).getContext("2d"), [least, most] = NARROW() ? [62, 112] : [96, 180];
  g.font = LABELS();
  const widest = Math.max(0, ...relay.lanes.map(([label]) => g.measureText(label).width));
  return Math.min(most, Math.max(least, Math.ceil(widest) + 10));
}

// The three series of a wave plot, by what is shown.
function seriesOf(relay, kind, mode) {
  const base = kind === "V" ? 0 : 3, [, factor] = relay.unit(kind);
  if (mode === "samples")
    return [0, 1, 2].map((k) => ({ name: relay.page.channels[base + k].toUpperCase(), colour: "--phase-" + "abc"[k],
      values: Float64Array.from(relay.samples[base + k], (y) => y * factor) }));
  const empty = () => new Float64Array(relay.t.length).fill(NaN), out = [empty(), empty(), empty()], [first] = relay.detail;
  for (let row = 0; row < relay.rows; row++) {
    const at = first + row * relay.step;
    const z = mode === "rms" ? [0, 1, 2].map((k) => relay.phasor(row, base + k)) : relay.sequence(row, base);
    z.forEach((one, k) => { out[k][at] = magnitude(one) * factor; });
  }
  const low = kind.toLowerCase();
  const names = mode === "rms" ? PHASES.map((p) => `|${kind}${p}|`) : [`|${kind}0|`, `|${kind}1|`, `|${kind}2|`];
  const colours = mode === "rms" ? ["--phase-a", "--phase-b", "--phase-c"] : ["--zero", "--phase-c", "--phase-a"];
  return out.map((values, k) => ({ name: names[k], colour: colours[k], values, low }));
}

// uPlot wants null where nothing is; NaN would be drawn as zero by some paths.
const nullable = (values) => Array.from(values, (y) => (Number.isNaN(y) ? null : y));

function axes(last, room, vertical, title = "") {
  const grid = { stroke: () => css("--grid"), width: 1 }, stroke = () => css("--soft");
  const x = { stroke, grid, ticks: grid, font: FONT, size: last ? 26 : 0,
    ...(last ? { label: title, labelSize: 20, labelFont: FONT, labelGap: 2 } : {}),
    values: last ? (u, ticks) => ticks.map((v) => String(+v.toFixed(6))) : () => [] };
  return [x, { stroke, grid, ticks: grid, font: FONT, size: room, ...vertical }];
}

// Marks of fault, trip and opening; shading where only an overview is; never a line of its own over a text.
function drawMarks(u, relay, labelled) {
  const { ctx: g, bbox } = u, ratio = devicePixelRatio || 1;
  g.save(); g.beginPath(); g.rect(bbox.left, 0, bbox.width, bbox.top + bbox.height); g.clip();
  const [first, end] = relay.detail, t = relay.t;
  if (relay.stretch_ms > 0) {
    g.fillStyle = css("--overview");
    const a = end > first ? u.valToPos(t[first], "x", true) : Infinity, b = end > first ? u.valToPos(t[end - 1], "x", true) : Infinity;
    if (a > bbox.left) g.fillRect(bbox.left, bbox.top, a - bbox.left, bbox.height);
    if (b < bbox.left + bbox.width) g.fillRect(Math.max(b, bbox.left), bbox.top, bbox.left + bbox.width - b, bbox.height);
  }
  g.font = `${11 * ratio}px system-ui, sans-serif`; g.textAlign = "left"; g.textBaseline = "middle";
  const ends = [];
  for (const [ms, name] of relay.marks) {
    const x = u.valToPos(ms, "x", true);
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    g.strokeStyle = css("--ink"); g.lineWidth = ratio; g.setLineDash(name === "fault" ? [] : [4 * ratio, 3 * ratio]);
    g.beginPath(); g.moveTo(x, bbox.top); g.lineTo(x, bbox.top + bbox.height); g.stroke(); g.setLineDash([]);
    if (!labelled) continue;
    const at = NARROW() ? ms.toFixed(1) : `${ms.toFixed(2)} ms`, words = name === "fault" && ms === 0 ? "fault" : `${name} ${at}`, wide = g.measureText(words).width;
    let left = x + 3 * ratio;
    if (left + wide > bbox.left + bbox.width) left = x - wide - 3 * ratio;
    let lane = ends.findIndex((stop) => stop + 6 * ratio < left);
    if (lane < 0) lane = ends.length;
    ends[lane] = left + wide;
    if (lane >= LANES()) continue;
    g.fillStyle = css("--ink"); g.fillText(words, left, bbox.top - (8 + 13 * lane) * ratio);
  }
  g.restore();
}

function drawLanes(u, relay, room) {
  const { ctx: g, bbox } = u, ratio = devicePixelRatio || 1, n = relay.lanes.length, height = bbox.height / Math.max(n, 1);
  g.save();
  g.font = LABELS().replace(/^\d+/, (size) => size * ratio); g.textAlign = "right"; g.textBaseline = "middle"; g.fillStyle = css("--soft");
  relay.lanes.forEach(([label], i) => {
    let words = label;
    while (words.length > 2 && g.measureText(words).width > (room - 8) * ratio) words = words.slice(0, -2) + "…";
    g.fillText(words, bbox.left - 6 * ratio, bbox.top + (i + 0.5) * height);
  });
  g.beginPath(); g.rect(bbox.left, bbox.top, bbox.width, bbox.height); g.clip();
  relay.lanes.forEach(([, bars], i) => {
    for (const [start, stop, kind, , lane, lanes] of bars) {
      const a = Math.max(u.valToPos(start, "x", true), bbox.left - 5), b = Math.min(u.valToPos(stop, "x", true), bbox.left + bbox.width + 5);
      if (b < a) continue;
      const thick = height * 0.74 / lanes;
      g.fillStyle = css("--k-" + kind);
      g.fillRect(a, bbox.top + (i + 0.13) * height + lane * thick, Math.max(b - a, ratio), Math.max(thick - (lanes > 1 ? ratio : 0), ratio));
    }
  });
  g.restore();
}

class Waves {
  constructor(relay, root, page) {
    Object.assign(this, { relay, root, page, plots: [], hidden: { V: new Set(), I: new Set() } });
    this.build();
  }
  build() {
    this.plots.forEach((u) => u.destroy());
    this.plots = [];
    this.root.replaceChildren();
    this.room = axisWidth(this.relay);
    this.root.parentElement.style.setProperty("--room", this.room + "px"); // captions begin where the plots do
    for (const kind of ["V", "I"]) this.plots.push(this.wave(kind));
    if (this.relay.lanes.length) this.plots.push(this.lanes());
    this.plots.forEach((u) => this.cursors(u));
  }
  get width() { return Math.max(this.root.clientWidth, 260); }
  common(height) {
    const range = (u, low, high) => (low === null ? [-1, 1] : uPlot.rangeNum(low, high, 0.1, true));
    return { width: this.width, height, legend: { show: false }, scales: { x: { time: false }, y: { range } },
      cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, x: false, y: false } };
  }
  wave(kind) {
    const shown = seriesOf(this.relay, kind, this.page.mode), [unit] = this.relay.unit(kind), there = this.relay.has(kind);
    const what = { samples: "", rms: " RMS", sequence: " RMS, sequence components" }[this.page.mode];
    const caption = document.createElement("div");
    caption.className = "caption";
    caption.append(`${kind === "V" ? "Voltage" : "Current"} [${unit}]${what}${there ? "" : ": " + NOTHING[kind]}`);
    this.root.append(caption);
    const marks = kind === "V";
    const last = kind === "I" && !this.relay.lanes.length;
    const u = new uPlot({ ...this.common((NARROW() ? 140 : 190) + (marks ? 20 : 0) + (last ? 46 : 0)), padding: [marks ? 4 + 13 * LANES() : 8, 18, 6, 0],
      axes: axes(last, this.room, there ? {} : { values: () => [] }, this.page.title),
      series: [{}, ...shown.map((s, k) => ({ label: s.name, stroke: () => css(s.colour), width: 1.3, show: !this.hidden[kind].has(k), spanGaps: this.page.mode !== "samples" && this.relay.step > 1, points: { show: false } }))],
      hooks: { drawClear: [(v) => drawMarks(v, this.relay, marks)] } },
      [this.relay.t, ...shown.map((s) => nullable(s.values))], this.root);
    if (there) shown.forEach((s, k) => {
      const button = document.createElement("button");
      button.innerHTML = `<span class="swatch" style="background:var(${s.colour})"></span>`;
      button.append(s.name);
      button.setAttribute("aria-pressed", String(!this.hidden[kind].has(k)));
      button.onclick = () => {
        const hide = !this.hidden[kind].has(k);
        this.hidden[kind][hide ? "add" : "delete"](k);
        button.setAttribute("aria-pressed", String(!hide));
        u.setSeries(k + 1, { show: !hide });
      };
      caption.append(button);
    });
    return u;
  }
  lanes() {
    const caption = document.createElement("div");
    caption.className = "caption";
    const kinds = [...new Set(this.relay.lanes.flatMap(([, bars]) => bars.map((bar) => bar[2])))];
    caption.innerHTML = kinds.map((kind) => `<span><span class="swatch box" style="background:var(--k-${kind})"></span>${this.page.kinds[kind]}</span>`).join("");
    this.root.append(caption);
    const n = this.relay.lanes.length;
    return new uPlot({ ...this.common(18 * n + 62), padding: [4, 18, 6, 0], scales: { x: { time: false }, y: { range: [0, n] } },
      axes: axes(true, this.room, { values: () => [], grid: { show: false }, ticks: { show: false } }, this.page.title), series: [{}, { show: false }],
      hooks: { drawClear: [(v) => drawMarks(v, this.relay, false)], draw: [(v) => drawLanes(v, this.relay, this.room)] } },
      [this.relay.t, new Array(this.relay.t.length).fill(null)], this.root);
  }
  cursors(u) {
    const over = u.over;
    u.marks = ["a", "b"].map((name) => { const d = document.createElement("div"); d.className = "mark-" + name; d.hidden = true; over.append(d); return d; });
    let down = null;
    const time = (event) => u.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
    over.addEventListener("pointerdown", (event) => { down = event.clientX; if (event.pointerType !== "mouse") this.page.setA(time(event)); });
    over.addEventListener("pointermove", (event) => { if (event.pointerType === "mouse" || event.buttons) this.page.setA(time(event)); });
    over.addEventListener("click", (event) => { if (down !== null && Math.abs(event.clientX - down) < 4) this.page.setB(time(event)); });
    over.addEventListener("dblclick", () => this.page.setRange(...this.page.window));
    over.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return; // the page's own wheel scrolls the page
      event.preventDefault();
      this.page.zoom(event.deltaY > 0 ? 1.25 : 0.8, time(event));
    }, { passive: false });
    u.hooks.setSelect = [(v) => {
      if (v.select.width > 4) this.page.setRange(v.posToVal(v.select.left, "x"), v.posToVal(v.select.left + v.select.width, "x"));
      v.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    }];
  }
  setRange(from, to) { this.plots.forEach((u) => u.setScale("x", { min: from, max: to })); }
  place(times) {
    for (const u of this.plots) u.marks.forEach((mark, k) => {
      const x = times[k] === null ? NaN : u.valToPos(times[k], "x");
      mark.hidden = !(x >= 0 && x <= u.over.clientWidth);
      if (!mark.hidden) mark.style.left = x + "px";
    });
  }
  resize() { this.plots.forEach((u) => u.setSize({ width: this.width, height: u.height })); }
}
