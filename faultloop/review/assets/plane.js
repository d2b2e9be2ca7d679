// R-X plane: zones, line, the way of the loops, and where the cursors are on it.
"use strict";
// What is seen at first, for the shown loop: the zones as set, the line, the fault; and the zones as they are at
// the decision, as far as that doubles it at most.
function planeExtent(relay, ground) {
  relay.extents ||= {};
  if (relay.extents[relay.shown]) return relay.extents[relay.shown];
  const points = [[0, 0]], own = relay.page.loops.indexOf(relay.shown);
  for (const zone of Object.values(relay.zones)) points.push(...zone[ground ? "ground" : "phase"]);
  if (relay.z1) points.push(relay.z1);
  if (relay.loop) points.push(relay.loop.slice(1));
  else if (points.length === 1 && relay.load) points.push(relay.load.map((z) => 1.3 * z));
  const low = [0, 1].map((k) => Math.min(...points.map((p) => p[k]))), high = [0, 1].map((k) => Math.max(...points.map((p) => p[k])));
  const half = [0, 1].map((k) => (high[k] - low[k]) / 2), least = [0, 1].map((k) => low[k] - half[k]), most = [0, 1].map((k) => high[k] + half[k]);
  const row = relay.row(relay.at(relay.page.first()[0]));
  for (const zone of Object.values(relay.dynamic ? relay.dynamic.zones : {}))
    for (const point of characteristic(relay, row, zone, own) || [])
      for (const k of [0, 1]) { low[k] = Math.min(low[k], Math.max(point[k], least[k])); high[k] = Math.max(high[k], Math.min(point[k], most[k])); }
  const pad = 0.06 * Math.max(high[0] - low[0], high[1] - low[1]) || 1;
  return (relay.extents[relay.shown] = [low[0] - pad, high[0] + pad, low[1] - pad, high[1] + pad]);
}
function drawPlane(canvas, relay, rowA, rowB) {
  const [g, width, height] = canvas2d(canvas, Math.max(340, Math.min(canvas.clientWidth, 460))), ground = relay.shown.endsWith("G");
  const [r0, r1, x0, x1] = planeExtent(relay, ground), left = 34, bottom = 20;
  const tick = (v) => String(+v.toPrecision(6));
  const scale = Math.min((width - left - 6) / (r1 - r0), (height - bottom - 6) / (x1 - x0)) / relay.distance;
  const mid = [(r0 + r1) / 2, (x0 + x1) / 2], centre = [(width + left) / 2, (height - bottom) / 2];
  const px = (r) => centre[0] + (r - mid[0]) * scale, py = (x) => centre[1] - (x - mid[1]) * scale;
  const factor = relay.factor("Z"), soft = css("--soft");
  // grid
  const span = (width - left) / scale * factor, rough = span / 8, ten = 10 ** Math.floor(Math.log10(rough));
  const step = ten * [1, 2, 5, 10].find((m) => m * ten >= rough) / factor;
  g.lineWidth = 1; g.strokeStyle = css("--grid"); g.fillStyle = soft;
  g.save(); g.beginPath(); g.rect(left, 0, width - left, height - bottom); g.clip();
  const ticks = (from, to) => { const all = []; for (let v = Math.ceil(from / step) * step; v <= to; v += step) all.push(Math.abs(v) < step / 1e6 ? 0 : v); return all; };
  const rs = ticks(mid[0] + (left - centre[0]) / scale, mid[0] + (width - centre[0]) / scale);
  const xs = ticks(mid[1] - (height - bottom - centre[1]) / scale, mid[1] + centre[1] / scale);
  for (const r of rs) { g.beginPath(); g.moveTo(px(r), 0); g.lineTo(px(r), height); g.stroke(); }
  for (const x of xs) { g.beginPath(); g.moveTo(0, py(x)); g.lineTo(width, py(x)); g.stroke(); }
  g.strokeStyle = soft; g.beginPath(); g.moveTo(px(0), 0); g.lineTo(px(0), height); g.moveTo(0, py(0)); g.lineTo(width, py(0)); g.stroke();
  // zones, line
  const way = (points, close) => {
    g.beginPath(); points.forEach(([r, x], i) => (i ? g.lineTo(px(r), py(x)) : g.moveTo(px(r), py(x)))); if (close) g.closePath();
  };
  const own = relay.page.loops.indexOf(relay.shown), now = {};
  for (const [name, zone] of Object.entries(relay.dynamic ? relay.dynamic.zones : {})) { const points = characteristic(relay, rowA, zone, own); if (points) now[name] = points; }
  g.strokeStyle = css("--accent");
  for (const [name, zone] of Object.entries(relay.zones)) {
    const points = zone[ground ? "ground" : "phase"];
    if (points.length < 3) continue;
    if (now[name]) { g.lineWidth = 1.6; way(now[name], true); g.stroke(); g.globalAlpha = 0.55; g.setLineDash([3, 4]); }
    g.lineWidth = now[name] ? 1 : 1.3; way(points, true); g.stroke(); g.globalAlpha = 1; g.setLineDash([]);
  }
  if (relay.z1) { g.strokeStyle = css("--ink"); g.lineWidth = 3; way([[0, 0], relay.z1]); g.stroke(); }
  // loci, from just before the fault to its end
  const [first] = relay.detail, [from, to] = relay.locus;
  const order = relay.page.loops.map((name, k) => [name, k]).sort(([one]) => (one === relay.shown ? 1 : 0));
  order.forEach(([name, k]) => {
    const main = name === relay.shown;
    g.strokeStyle = css("--" + name); g.lineWidth = main ? 2.2 : 0.8; g.globalAlpha = main ? 1 : 0.45;
    g.beginPath();
    let open = false;
    for (let row = 0; row < relay.rows; row++) {
      const ms = relay.t[first + row * relay.step], z = relay.impedance(row, k);
      if (ms < from || ms > to || !Number.isFinite(z[0])) { open = false; continue; }
      const x = Math.max(-1e4, Math.min(1e4, px(z[0]))), y = Math.max(-1e4, Math.min(1e4, py(z[1])));
      if (open) g.lineTo(x, y); else { g.moveTo(x, y); open = true; }
    }
    g.stroke();
  });
  g.globalAlpha = 1;
  // the zones' names: on their outline, away from the line, the shown loop's way, the cursors and one another
  const busy = [], used = [], shownAt = (row) => { const z = relay.impedance(row, own); return [px(z[0]), py(z[1])]; };
  const strew = (one, two) => {
    const steps = Math.min(200, Math.ceil(Math.hypot(two[0] - one[0], two[1] - one[1]) / 4));
    for (let n = 0; n <= steps; n++) busy.push([one[0] + (two[0] - one[0]) * n / steps, one[1] + (two[1] - one[1]) * n / steps]);
  };
  if (relay.z1) strew([px(0), py(0)], [px(relay.z1[0]), py(relay.z1[1])]);
  for (let row = 1; row < relay.rows; row++) {
    const ms = relay.t[first + row * relay.step], one = shownAt(row - 1), two = shownAt(row);
    if (ms >= from && ms <= to && [...one, ...two].every((v) => Math.abs(v) < 2 * width)) strew(one, two);
  }
  for (const row of [rowA, rowB]) if (row >= 0) for (let n = 0; n < 20; n++) busy.push(shownAt(row));
  g.font = "11px system-ui, sans-serif"; g.textAlign = "center";
  for (const [name, zone] of Object.entries(relay.zones)) {
    const set = zone[ground ? "ground" : "phase"], points = now[name] || set;
    if (set.length < 3 || points.length < 3) continue;
    const reverse = set.reduce((s, p) => s + p[1], 0) < 0, half = g.measureText(name).width / 2 + 2;
    const top = points.reduce((best, p, n) => ((reverse ? p[1] < points[best][1] : p[1] > points[best][1]) ? n : best), 0);
    let best = null;
    for (let n = 0; n < 48; n++) { // from the top outwards, to both sides
      const aside = (n % 2 ? 1 : -1) * Math.ceil(n / 2) / 48, [r, x] = points[(top + Math.round((aside + 1) * points.length)) % points.length];
      const place = [Math.max(left + half, Math.min(width - half, px(r))), Math.max(12, Math.min(height - bottom - 4, py(x) + (reverse ? 13 : -4)))];
      const moved = Math.abs(place[0] - px(r)) + Math.abs(place[1] - py(x)) > 15 ? 500 : 0, middle = [place[0], place[1] - 4];
      const cost = n / 2 + moved + 400 * used.filter((u) => Math.abs(u[0] - middle[0]) < u[2] + half && Math.abs(u[1] - middle[1]) < 13).length
        + 8 * busy.filter((u) => Math.abs(u[0] - middle[0]) < half + 4 && Math.abs(u[1] - middle[1]) < 11).length;
      if (!best || cost < best[0]) best = [cost, place, middle];
    }
    const [, place, middle] = best;
    used.push([...middle, half]);
    g.fillStyle = css("--paper"); g.fillRect(place[0] - half, place[1] - 10, 2 * half, 12);
    g.fillStyle = css("--accent"); g.fillText(name, place[0], place[1]);
  }
  const spot = (row, colour, filled) => {
    const z = relay.impedance(row, relay.page.loops.indexOf(relay.shown));
    if (!Number.isFinite(z[0])) return;
    g.strokeStyle = g.fillStyle = colour; g.lineWidth = 2.2; g.beginPath(); g.arc(px(z[0]), py(z[1]), 4.5, 0, 7); if (filled) g.fill(); g.stroke();
  };
  spot(rowB, css("--cursor-b"), false); spot(rowA, css("--cursor-a"), true);
  g.restore();
  g.fillStyle = soft; g.textAlign = "center";
  let last = -Infinity;
  for (const r of rs) if (px(r) > left + 8 && px(r) < width - 46 && px(r) - last > 34) { g.fillText(tick(r * factor), px(r), height - 7); last = px(r); }
  g.textAlign = "right"; g.fillText("R, Ω", width - 2, height - 7); g.textAlign = "center";
  g.textAlign = "right"; last = Infinity;
  for (const x of xs) if (py(x) > 18 && py(x) < height - bottom && last - py(x) > 14) { g.fillText(tick(x * factor), left - 4, py(x) + 4); last = py(x); }
  g.textAlign = "left"; g.fillText("X, Ω", 0, 11);
}
