// The page as a whole: one time range, two cursors, what all relays show of them.
"use strict";
class Page {
  constructor(data) {
    Object.assign(this, { data, channels: data.channels, loops: data.loops, kinds: data.kinds, window: data.window,
      title: `time from ${data.from_inception ? "the fault's inception" : "the log's start"}, ms`,
      mode: "samples", secondary: false, a: null, b: null, range: [...data.window], pending: false });
    this.relays = data.relays.map((one) => new Relay(one, this));
    this.sections = this.relays.map((relay, k) => this.section(relay, k));
    this.controls();
    const asked = new URLSearchParams(location.hash.slice(1)), number = (key) => (asked.has(key) ? Number(asked.get(key)) : null);
    if (asked.has("theme")) this.setTheme(asked.get("theme"));
    if (asked.has("mode")) this.setMode(asked.get("mode"));
    this.setRange(number("from") ?? this.window[0], number("to") ?? this.window[1]);
    const [a, b] = this.first();
    this.b = this.snapped(number("b") ?? b);
    this.setA(number("a") ?? a);
    addEventListener("resize", () => { clearTimeout(this.later); this.later = setTimeout(() => this.rebuild(), 120); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.setTheme(this.theme || "auto"));
    document.documentElement.dataset.ready = "1";
  }
  // Where the cursors begin: the first decision and the inception; else the fault as it was located, or the middle.
  first() {
    const decided = this.relays.flatMap((relay) => relay.marks).find(([, name]) => name !== "fault");
    const located = this.relays.find((relay) => relay.loop), middle = (this.window[0] + this.window[1]) / 2;
    if (!this.data.from_inception) return [middle, middle - 1e3 / this.data.nominal_hz];
    return [decided ? decided[0] : located ? located.locus[1] : 0, 0];
  }
  section(relay, k) {
    const root = document.querySelector(`[data-relay="${k}"]`), find = (name) => root.querySelector("." + name);
    const plots = find("plots");
    plots.tabIndex = 0;
    plots.addEventListener("keydown", (event) => this.key(event, relay));
    const loops = this.loops.map((name) => {
      const button = document.createElement("button");
      button.textContent = name; button.style.boxShadow = `inset 0 -3px 0 var(--${name})`;
      button.onclick = () => { relay.shown = name; this.refresh(); };
      return button;
    });
    find("loops").replaceChildren(...loops);
    for (const [name, by] of [["nearer", 1 / 1.5], ["farther", 1.5]]) find(name).onclick = () => { relay.distance *= by; this.refresh(); };
    return { relay, loops, waves: new Waves(relay, plots, this), phasors: find("phasors"), plane: find("plane"), values: find("values"), impedance: find("impedance") };
  }
  controls() {
    const on = (id, action) => { const button = document.getElementById(id); if (button) button.onclick = () => action(button); };
    on("fault", () => this.setRange(...this.window));
    on("whole", () => this.setRange(...this.whole()));
    on("in", () => this.zoom(0.5));
    on("out", () => this.zoom(2));
    for (const mode of ["samples", "rms", "sequence"]) on(mode, () => this.setMode(mode));
    on("secondary", (button) => { this.secondary = !this.secondary; button.setAttribute("aria-pressed", String(this.secondary)); this.rebuild(); });
    on("theme", () => this.setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"));
    for (const row of document.querySelectorAll("[data-ms]")) {
      const jump = () => { const ms = Number(row.dataset.ms), half = Math.max((this.range[1] - this.range[0]) / 2, 1);
        if (ms < this.range[0] || ms > this.range[1]) this.setRange(ms - half, ms + half);
        this.setA(ms); document.querySelector(".relay")?.scrollIntoView({ behavior: "smooth", block: "nearest" }); };
      row.tabIndex = 0; row.onclick = jump; row.onkeydown = (event) => { if (event.key === "Enter") jump(); };
    }
  }
  whole() {
    const ends = this.relays.filter((relay) => relay.t.length).flatMap((relay) => [relay.t[0], relay.t[relay.t.length - 1]]);
    return ends.length ? [Math.min(...ends), Math.max(...ends)] : this.window;
  }
  key(event, relay) {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "b") this.setB(this.a);
    else if (event.key === "Home") this.setA(this.range[0]);
    else if (event.key === "End") this.setA(this.range[1]);
    else if (move) { const at = relay.at(this.a) + move * (event.shiftKey ? 10 : 1); this.setA(relay.t[Math.max(0, Math.min(relay.t.length - 1, at))]); }
    else return;
    event.preventDefault();
  }
  snapped(ms) {
    const relay = this.relays.find((one) => one.t.length), at = relay ? relay.at(ms) : -1;
    return at < 0 ? ms : relay.t[at];
  }
  setA(ms) { this.a = this.snapped(ms); this.refresh(); }
  setB(ms) { this.b = this.snapped(ms); this.refresh(); }
  setRange(from, to) {
    if (!(to - from > 1e-6)) return;
    this.range = [from, to];
    this.sections.forEach((own) => own.waves.setRange(from, to));
    this.refresh();
  }
  zoom(by, about = null) {
    const [from, to] = this.range, at = about ?? (this.a >= from && this.a <= to ? this.a : (from + to) / 2);
    this.setRange(at - (at - from) * by, at + (to - at) * by);
  }
  setMode(mode) {
    if (!["samples", "rms", "sequence"].includes(mode)) return;
    this.mode = mode;
    for (const one of ["samples", "rms", "sequence"]) document.getElementById(one).setAttribute("aria-pressed", String(one === mode));
    this.rebuild();
  }
  setTheme(theme) {
    this.theme = theme;
    const dark = theme === "dark" || (theme === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    this.rebuild();
  }
  rebuild() { if (!this.sections) return; this.sections.forEach((own) => own.waves.build()); this.setRange(...this.range); }
  refresh() {
    if (this.pending || !this.sections) return;
    this.pending = true;
    requestAnimationFrame(() => { this.pending = false; this.draw(); });
  }
  draw() {
    const ms = (t) => (t === null ? "–" : t.toFixed(3) + " ms"), delta = this.a - this.b;
    document.getElementById("times").innerHTML = `<span class="a">A ${ms(this.a)}</span> &ensp;<span class="b">B ${ms(this.b)}</span> &ensp;A − B ${ms(delta)}` +
      (delta ? ` (${(delta * this.data.nominal_hz / 1e3).toFixed(2)} cycles)` : "");
    for (const own of this.sections) {
      const { relay } = own, [at, bt] = [this.a, this.b].map((t) => relay.at(t)), [row, rowB] = [at, bt].map((index) => relay.row(index));
      own.waves.place([this.a, this.b]);
      drawPhasors(own.phasors, relay, row);
      drawPlane(own.plane, relay, row, rowB);
      own.values.replaceChildren(...this.values(relay, at, bt, row));
      own.loops.forEach((button) => button.setAttribute("aria-pressed", String(button.textContent === relay.shown)));
      const z = relay.impedance(row, this.loops.indexOf(relay.shown)), f = relay.factor("Z");
      own.impedance.textContent = Number.isFinite(z[0]) ? `${relay.shown}: ${text(z[0] * f)} + j ${text(z[1] * f)} Ω, ${text(magnitude(z) * f)} Ω ∠ ${degrees(z).toFixed(1)}°` : `${relay.shown}: no impedance here`;
    }
  }
  values(relay, at, bt, row) {
    const cells = (tag, ...all) => { const tr = document.createElement("tr"); all.forEach(([words, mark]) => { const cell = document.createElement(tag); cell.textContent = words; if (mark) cell.className = mark; tr.append(cell); }); return tr; };
    const angle = (z) => (magnitude(z) > 0 ? (Math.round(10 * wrapped(degrees(z) - relay.reference_deg)) / 10 + 0).toFixed(1) + "°" : "–");
    const rows = [cells("th", [["V", "I"].map((kind) => relay.unit(kind)[0]).join(", ")], ["A", "a"], ["B", "b"], ["A − B"], ["RMS at A", "a"], ["angle", "a"])];
    const line = (name, unit, a, b, z) => {
      const f = relay.unit(unit)[1], digits = unit === "V" ? 2 : 3;
      const fixed = (value) => (Number.isFinite(value) ? (Math.abs(value) < 0.5 * 10 ** -digits ? 0 : value).toFixed(digits) : "–");
      rows.push(cells("td", [name], ...[a, b, a - b, magnitude(z)].map((value) => [fixed(value * f)]), [Number.isFinite(z[0]) ? angle(z) : "–"]));
    };
    this.channels.forEach((name, k) => line(name.toUpperCase(), k < 3 ? "V" : "I", at < 0 ? NaN : relay.samples[k][at], bt < 0 ? NaN : relay.samples[k][bt], relay.phasor(row, k)));
    for (const [from, unit] of [[0, "V"], [3, "I"]]) relay.sequence(row, from).forEach((z, k) => line(unit + k, unit, NaN, NaN, z));
    return rows;
  }
}
window.page = new Page(JSON.parse(document.getElementById("record").textContent));
