// A zone's characteristic as it is at an instant, with what polarizes it then (see review/characteristic.py).
"use strict";
const C = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1]], sub: (a, b) => [a[0] - b[0], a[1] - b[1]],
  mul: (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]], conj: (a) => [a[0], -a[1]],
  times: (k, a) => [k * a[0], k * a[1]], div: (a, b) => C.times(1 / (b[0] * b[0] + b[1] * b[1]), C.mul(a, C.conj(b))),
};
const TURN = [-0.5, Math.sqrt(3) / 2], BACK = C.conj(TURN), ONE = [1, 0];
const POSITIVE = [ONE, BACK, TURN, C.sub(ONE, BACK), C.sub(BACK, TURN), C.sub(TURN, ONE)];
const NEGATIVE = [ONE, TURN, BACK, C.sub(ONE, TURN), C.sub(TURN, BACK), C.sub(BACK, ONE)];
const [SELF, CROSS, MEMORY, OFFSET, QUAD] = [0, 1, 2, 3, 4], DYNAMIC = 10;
const ofLoop = (x, loop) => (loop < 3 ? x[loop] : C.sub(x[loop - 3], x[(loop - 2) % 3]));

// What the relay remembered at a row; null where nothing is disturbed.
function remembered(relay, row) {
  if (!relay.dynamic || row < 0) return null;
  const at = relay.remembered.subarray(DYNAMIC * row, DYNAMIC * row + DYNAMIC);
  if (!Number.isFinite(at[0])) return null;
  return { polarizing: [at[0], at[1]], currents: [0, 1, 2].map((k) => [at[2 + 2 * k], at[3 + 2 * k]]),
    frequency: at[8] / relay.dynamic.frequency, fault: at[9] % 8, holds: at[9] >= 8 };
}
function circle(middle, radius) {
  return Array.from({ length: 181 }, (_, k) => C.add(middle, C.mul(radius, [Math.cos(k * Math.PI / 90), Math.sin(k * Math.PI / 90)])));
}
function characteristic(relay, row, zone, loop) {
  const q = remembered(relay, row);
  if (!q || !(zone.loops >> loop & 1)) return null;
  const v = [0, 1, 2].map((k) => relay.phasor(row, k)), i = [3, 4, 5].map((k) => relay.phasor(row, k));
  const loopV = ofLoop(v, loop), sum = C.add(i[0], C.add(i[1], i[2]));
  const loopI = loop < 3 ? C.add(i[loop], C.mul(zone.k0, sum)) : ofLoop(i, loop);
  if (!(magnitude(loopI) > 0)) return null;
  const reach = [zone.reach[0], zone.reach[1] * q.frequency], drop = C.mul(reach, loopI);
  if (zone.shape === QUAD) return quadrilateral(relay, row, zone, loop, { q, i, loopI, reach, drop });
  if (zone.shape === OFFSET) return circle([0, 0], reach);
  let polarizing = C.mul(POSITIVE[loop], q.polarizing);
  if (zone.shape === SELF) polarizing = loopV;
  if (zone.shape === CROSS) polarizing = loop < 3
    ? C.mul([0, 1 / Math.sqrt(3)], C.sub(v[(loop + 1) % 3], v[(loop + 2) % 3])) : C.mul([0, -Math.sqrt(3)], v[(loop + 2) % 3]);
  if (zone.shape !== MEMORY) polarizing = C.add(polarizing, C.times(0.05, drop));
  const behind = C.times(-1, C.div(C.sub(polarizing, loopV), loopI));
  // without the part where the drop is against the polarizing voltage, beyond the line through `behind`
  const across = C.times(1 / magnitude(reach), C.mul([0, 1], reach)), dot = (a, b) => a[0] * b[0] + a[1] * b[1];
  const chord = dot(across, C.sub(reach, behind)), least = Math.min(chord, 0), most = Math.max(chord, 0);
  return circle(C.times(0.5, C.add(reach, behind)), C.times(0.5, C.sub(reach, behind))).map((point) => {
    const from = C.sub(point, behind);
    return dot(reach, from) < 0 ? C.add(behind, C.times(Math.max(least, Math.min(most, dot(across, from))), across)) : point;
  });
}
function quadrilateral(relay, row, zone, loop, { q, i, loopI, reach, drop }) {
  const [i0, i1, i2] = relay.sequence(row, 3), negative = C.mul(NEGATIVE[loop], i2);
  let polarizing = loopI, fault = loopI;
  if (loop < 3) {
    const small = magnitude(i2) < relay.dynamic.unbalance * magnitude(i1);
    polarizing = small ? C.times(3, i0) : negative;
    fault = C.times(1.5, small ? i0 : C.add(negative, i0));
  } else if (q.holds) polarizing = fault = ofLoop(i.map((z, k) => C.sub(z, q.currents[k])), loop);
  else if (q.fault !== 7) { polarizing = negative; fault = C.times(2, negative); }
  const along = C.mul(loopI, C.conj(C.mul(polarizing, C.conj(zone.tilt)))), beside = C.conj(reach);
  const determinant = along[1] * beside[0] - along[0] * beside[1];
  const scale = [C.mul(reach, along)[1], C.mul(fault, C.conj(drop))[1] / (loopI[0] ** 2 + loopI[1] ** 2)];
  if (!(Math.abs(determinant) > 1e-9 * Math.max(...along.map(Math.abs), ...beside.map(Math.abs)) ** 2)) return null;
  const limit = loop < 3 ? zone.ground : zone.phase, low = -0.15 - 0.27 * limit / magnitude(reach);
  const corners = zone.direction ? [[1, -limit], [1, limit], [low, limit], [-0.15, 0], [low, -limit]] : [[1, -limit], [1, limit], [-1, limit], [-1, -limit]];
  return [...corners, corners[0]].map(([m, r]) => { // Im(Z along) = m .., Im(Z beside) = r ..
    const [a, b] = [m * scale[0], r * scale[1]];
    return [(a * beside[0] - b * along[0]) / determinant, (b * along[1] - a * beside[1]) / determinant];
  });
}
