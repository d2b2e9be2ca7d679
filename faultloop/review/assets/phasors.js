// Phasor diagram at the cursor: voltages solid, currents dashed, each on a scale of its own.
"use strict";
function canvas2d(canvas, height) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 300;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio); canvas.style.height = height + "px";
  }
  const g = canvas.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  g.clearRect(0, 0, width, height);
  g.font = "12px system-ui, sans-serif";
  return [g, width, height];
}
function greatestPhasors(relay) {
  let v = 0, i = 0;
  for (let row = 0; row < relay.rows; row++) for (let k = 0; k < 6; k++) {
    const size = magnitude(relay.phasor(row, k));
    if (Number.isFinite(size)) { if (k < 3) v = Math.max(v, size); else i = Math.max(i, size); }
  }
  return [v, i];
}
function drawPhasors(canvas, relay, row) {
  const [g, width, height] = canvas2d(canvas, 240), x0 = width / 2, y0 = height / 2, radius = height / 2 - 22;
  relay.greatest = relay.greatest || greatestPhasors(relay);
  g.strokeStyle = css("--grid"); g.lineWidth = 1;
  for (const part of [0.5, 1]) { g.beginPath(); g.arc(x0, y0, radius * part, 0, 7); g.stroke(); }
  g.beginPath(); g.moveTo(x0 - radius, y0); g.lineTo(x0 + radius, y0); g.moveTo(x0, y0 - radius); g.lineTo(x0, y0 + radius); g.stroke();
  g.fillStyle = css("--soft");
  const scale = (k) => { const [unit, f] = relay.unit("VI"[k]); return relay.greatest[k] ? `circle ${text(relay.greatest[k] * f, 3)} ${unit}` : "none"; };
  g.textAlign = "left"; g.fillText("V: " + scale(0), 2, 12);
  g.textAlign = "right"; g.fillText("I: " + scale(1), width - 2, 12);
  if (row < 0) { g.textAlign = "center"; g.fillText("no estimates here: outside the detail", x0, y0 + 4); return; }
  const arrows = [];
  for (let k = 5; k >= 0; k--) {
    const z = relay.phasor(row, k), size = magnitude(z) / relay.greatest[k < 3 ? 0 : 1];
    if (!(size > 0.01)) continue;
    const angle = (degrees(z) - relay.reference_deg) * Math.PI / 180, length = radius * size;
    arrows.push({ k, angle, length, x: x0 + length * Math.cos(angle), y: y0 - length * Math.sin(angle) });
  }
  for (const { k, angle, length, x, y } of arrows) {
    g.strokeStyle = g.fillStyle = css("--phase-" + "abc"[k % 3]); g.lineWidth = k < 3 ? 2.4 : 1.8; g.setLineDash(k < 3 ? [] : [6, 4]);
    g.beginPath(); g.moveTo(x0, y0); g.lineTo(x, y); g.stroke(); g.setLineDash([]);
    g.beginPath(); g.moveTo(x, y);
    const head = Math.min(9, 0.7 * length);
    for (const side of [-1, 1]) g.lineTo(x - head * Math.cos(angle + side * 0.4), y + head * Math.sin(angle + side * 0.4));
    g.fill();
  }
  // a name would be greater than the smallest arrows
  const named = arrows.filter(({ length }) => length >= 0.09 * radius);
  g.textAlign = "center"; g.textBaseline = "middle"; g.lineJoin = "round";
  namePlaces(named, arrows, [x0, y0], [width, height]).forEach(([x, y], n) => {
    const own = named[n], name = relay.page.channels[own.k].toUpperCase(), far = Math.hypot(x - own.x, y - own.y);
    g.strokeStyle = g.fillStyle = css("--phase-" + "abc"[own.k % 3]);
    if (far > 24) { // a thread from the name to its tip
      const part = 11 / far;
      g.lineWidth = 0.8; g.beginPath(); g.moveTo(own.x, own.y); g.lineTo(x + (own.x - x) * part, y + (own.y - y) * part); g.stroke();
    }
    g.strokeStyle = css("--paper"); g.lineWidth = 3; g.strokeText(name, x, y);
    g.fillText(name, x, y);
  });
  g.textBaseline = "alphabetic";
}
// Where each name stands: as near to its tip as it is clear of every arrow and of the other names.
const NAME_HALF = [10, 7];
function namePlaces(named, arrows, [x0, y0], [width, height]) {
  const inside = ([x, y], u) => Math.abs(u[0] - x) < NAME_HALF[0] && Math.abs(u[1] - y) < NAME_HALF[1], busy = [], used = [];
  for (const { x, y, length } of arrows) {
    const steps = Math.max(1, Math.ceil(length / 3));
    for (let n = 0; n <= steps; n++) busy.push([x0 + (x - x0) * n / steps, y0 + (y - y0) * n / steps]);
  }
  for (const { x, y, angle } of named) {
    let best = null;
    for (let far = 11; far <= 47; far += 4) for (let turn = 0; turn < 24; turn++) {
      const aside = (turn % 2 ? 1 : -1) * Math.ceil(turn / 2) * Math.PI / 12, place = [x + far * Math.cos(angle + aside), y - far * Math.sin(angle + aside)];
      if (place[0] < NAME_HALF[0] || place[0] > width - NAME_HALF[0] || place[1] < 20 || place[1] > height - NAME_HALF[1]) continue;
      const met = used.filter((u) => Math.abs(u[0] - place[0]) < 2 * NAME_HALF[0] && Math.abs(u[1] - place[1]) < 2 * NAME_HALF[1]).length;
      const cost = far + 3 * Math.abs(aside) + 300 * met + 100 * busy.filter((u) => inside(place, u)).length;
      if (!best || cost < best[0]) best = [cost, place];
    }
    used.push(best ? best[1] : [x, y]);
  }
  return used;
}
