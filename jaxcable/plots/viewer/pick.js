// What is under the pointer: the picture is searched once per click, which is fast enough.

// Place in pixels of a position, and its depth; null behind the eye.
function onScreen(m, x, y, z, width, height) {
  const w = m[3] * x + m[7] * y + m[11] * z + m[15];
  if (w < 1e-5) return null;
  const u = (m[0] * x + m[4] * y + m[8] * z + m[12]) / w, v = (m[1] * x + m[5] * y + m[9] * z + m[13]) / w;
  const depth = (m[2] * x + m[6] * y + m[10] * z + m[14]) / w;
  return [0.5 * width * (1 + u), 0.5 * height * (1 - v), depth];
}

// A node within `reach` pixels, else the element, else the face under the pointer: { kind, number }
// or null. Of those that are about as near to the pointer, the one in front.
function pickAt(x, y, reach, matrix, width, height, places, segments, owner, seen, corners, face) {
  let best = null;
  const offer = (kind, number, apart, depth, segment = -1) => {
    const score = apart + 2 * reach * depth;  // depths differ by little within a structure
    if (!best || score < best.score) best = { kind, number, segment, score };
  };
  for (let i = 0; i < places.length; i += 3) {
    if (!seen.node(i / 3)) continue;
    const p = onScreen(matrix, places[i], places[i + 1], places[i + 2], width, height);
    if (!p) continue;
    const apart = Math.hypot(p[0] - x, p[1] - y);
    if (apart <= reach) offer("node", i / 3, apart, p[2]);
  }
  if (best) return best;
  for (let s = 0; s < owner.length; s++) {
    if (!seen.element(owner[s])) continue;
    const i = 6 * s;
    const p = onScreen(matrix, segments[i], segments[i + 1], segments[i + 2], width, height);
    const q = onScreen(matrix, segments[i + 3], segments[i + 4], segments[i + 5], width, height);
    if (!p || !q) continue;
    const dx = q[0] - p[0], dy = q[1] - p[1], square = dx * dx + dy * dy;
    const t = square > 0 ? Math.min(1, Math.max(0, ((x - p[0]) * dx + (y - p[1]) * dy) / square)) : 0;
    const apart = Math.hypot(p[0] + t * dx - x, p[1] + t * dy - y);
    if (apart <= reach) offer("element", owner[s], apart, p[2] + t * (q[2] - p[2]), s);
  }
  if (best) return best;
  for (let t = 0; t < corners.length / 3; t++) {
    const [a, b, c] = [0, 1, 2].map(j => 3 * corners[3 * t + j])
      .map(i => onScreen(matrix, places[i], places[i + 1], places[i + 2], width, height));
    if (!seen.element(face[t]) || !a || !b || !c) continue;
    const side = (p, q) => (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
    const parts = [side(b, c), side(c, a), side(a, b)], whole = parts[0] + parts[1] + parts[2];
    if (whole === 0 || parts.some(part => part / whole < 0)) continue;
    offer("element", face[t], 0, (parts[0] * a[2] + parts[1] * b[2] + parts[2] * c[2]) / whole);
  }
  return best;
}
