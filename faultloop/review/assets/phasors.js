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
  const used = [], tips = [];
  const away = ([a, b]) => Math.min(...tips.map(([x, y]) => { // of a point from the nearest arrow
    const part = Math.min(Math.max(((a - x0) * x + (b - y0) * y) / (x * x + y * y), 0), 1);
    return Math.hypot(a - x0 - part * x, b - y0 - part * y);
  }));
  for (let k = 0; k < 6; k++) {
    const z = relay.phasor(row, k), size = radius * magnitude(z) / relay.greatest[k < 3 ? 0 : 1];
    const angle = (degrees(z) - relay.reference_deg) * Math.PI / 180;
    if (size > 0.01 * radius) tips.push([size * Math.cos(angle), -size * Math.sin(angle)]);
  }
  for (let k = 5; k >= 0; k--) {
    const z = relay.phasor(row, k), size = magnitude(z) / relay.greatest[k < 3 ? 0 : 1];
    if (!(size > 0.01)) continue;
    const angle = (degrees(z) - relay.reference_deg) * Math.PI / 180, colour = css("--phase-" + "abc"[k % 3]);
    const x = x0 + radius * size * Math.cos(angle), y = y0 - radius * size * Math.sin(angle);
    g.strokeStyle = g.fillStyle = colour; g.lineWidth = k < 3 ? 2.4 : 1.8; g.setLineDash(k < 3 ? [] : [6, 4]);
    g.beginPath(); g.moveTo(x0, y0); g.lineTo(x, y); g.stroke(); g.setLineDash([]);
    g.beginPath(); g.moveTo(x, y);
    const head = Math.min(9, 0.7 * radius * size);
    for (const side of [-1, 1]) g.lineTo(x - head * Math.cos(angle + side * 0.4), y + head * Math.sin(angle + side * 0.4));
    g.fill();
    if (size < 0.09) continue; // a name would be greater than its arrow
    // the name beyond the tip, or beside it where another one, or an arrow, is
    const name = relay.page.channels[k].toUpperCase();
    const places = [[11, 0], [14, 1], [14, -1], [15, 1.4], [15, -1.4], [24, 0], [22, 0.7], [22, -0.7], [34, 0.4], [34, -0.4], [46, 0]];
    const at = places.map(([far, aside]) => [x + far * Math.cos(angle + aside), y - far * Math.sin(angle + aside)]);
    const free = at.filter(([a, b]) => !used.some(([c, d]) => Math.abs(a - c) < 20 && Math.abs(b - d) < 12));
    const place = free.find((one) => away(one) > 10.5) || free.sort((one, other) => away(other) - away(one))[0] || at[0];
    used.push(place);
    g.textAlign = "center"; g.textBaseline = "middle";
    g.fillText(name, ...place);
    g.textBaseline = "alphabetic";
  }
}
