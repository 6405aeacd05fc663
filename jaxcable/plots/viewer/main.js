// The page as a whole: what is shown, and what mouse, fingers, keys and controls do to it.

const model = decode(byId("data").textContent, byId("bytes").textContent);
byId("bytes").textContent = "";  // the text is not needed any more
const shape = new Shape(model), camera = new Camera(), canvas = byId("canvas");
const lastShot = model.shots.length - 1;
const shown = {
  shot: lastShot, reference: -1, magnify: 1, color: model.color, picked: null, playing: null,
  nodes: [], segments: [], ranges: new Map(),
};
let drawing = null, dirty = false, scene = null;

// --- colors

const rgb = text => {  // of "#rrggbb", bytes
  const n = parseInt(text.slice(1), 16);
  return [n >> 16, (n >> 8) & 255, n & 255];
};

function theme() {
  const style = getComputedStyle(document.body);
  const read = text => text.match(/[\d.]+/g).slice(0, 3).map(x => Number(x) / 255);
  const ground = read(style.backgroundColor), ink = read(style.color);
  const dark = ground[0] + ground[1] + ground[2] < 1.5;
  return { dark, ground, ink, accent: dark ? [1, 0.82, 0.25] : [0.9, 0.62, 0],
    scale: dark ? model.colors.darkScale : model.colors.scale,
    load: dark ? "#f0f2f5" : model.colors.load, reaction: model.colors.reaction, slack: model.colors.slack,
    ghost: dark ? "#5a626e" : "#b9bec6", y: dark ? "#2fc79a" : "#009e73", z: dark ? "#56b4e9" : "#0072b2" };
}

// 256 colors between the given ones.
function table(scale) {
  const stops = scale.map(rgb), out = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; i++) {
    const t = i / 255 * (stops.length - 1), k = Math.min(Math.floor(t), stops.length - 2);
    for (let c = 0; c < 3; c++) out[3 * i + c] = stops[k][c] + (t - k) * (stops[k + 1][c] - stops[k][c]);
  }
  return out;
}

// --- the scene: what changes with the shot, the factor, the colors

const weights = () => Shape.weights(shown.shot, shown.reference, shown.magnify);
const present = element => !(model.row("looks", shown.shot)[element] & 4);

function fill(count, bytes) {
  const out = new Uint8Array(4 * count);
  for (let i = 0; i < out.length; i++) out[i] = bytes[i % 4];
  return out;
}

function lineWidth() { return Math.min(3, Math.max(1.1, 3 * Math.sqrt(120 / Math.max(shape.count, 1)))); }

function currentRange() {
  const column = model.columns.find(c => c.label === shown.color);
  if (!column) return null;
  // tensions of segments of cables with friction count beside the means of the cables
  const parts = column.label === "tension" && model.get("segment_tension");
  const all = (values, more) => (more ? [values, more].flatMap(x => Array.from(x)) : values);
  if (byId("own-range").checked)
    return new Range(column, all(model.row(column.array, shown.shot), parts && model.row("segment_tension", shown.shot)), false);
  if (!shown.ranges.has(column.label)) shown.ranges.set(column.label, new Range(column, all(model.get(column.array), parts), true));
  return shown.ranges.get(column.label);
}

function rebuild() {
  const look = scene = theme(), own = weights();
  shown.nodes = shape.nodes(own);
  shown.segments = shape.segments(own, shown.nodes);
  const keys = [];
  ghostLayer(look, keys);
  memberLayer(look, keys);
  axesLayer(look, own, keys);
  diagramLayer(look, own, keys);
  arrowLayers(look, keys);
  markLayers(keys);
  pickedLayer(look);
  showKeys(keys);
  showPicked(model, shown.picked, shown.shot, shape);
  showTime();
  request();
}

function ghostLayer(look, keys) {
  const same = shown.reference === shown.shot;
  if (!byId("ghost").checked || same) { drawing.hide("ghost"); return; }
  const segments = shape.segments(Shape.weights(shown.reference, -1, 1));
  const width = Math.min(1.2, lineWidth());
  drawing.set("ghost", "lines", [segments, fill(shape.count, [...rgb(look.ghost), 255]), fill(shape.count, [10 * width, 0, 0, 0])], { behind: true });
  keys.push([byId("reference").selectedOptions[0].text, { stroke: look.ghost, width: 1.4 }]);
}

function memberLayer(look, keys) {
  const looks = model.row("looks", shown.shot), owner = shape.owner, width = lineWidth();
  const range = currentRange(), column = model.columns.find(c => c.label === shown.color);
  const values = column && model.row(column.array, shown.shot), colors = table(look.scale), slack = rgb(look.slack);
  // colors by element: pieces of one element look alike, but for segments with tensions of their own
  const tint = new Uint8Array(3 * model.nElem);
  let unknown = 0;
  for (let e = 0; e < model.nElem; e++) {
    const t = range ? range.part(values[e]) : NaN;
    if (looks[e] & 1) tint.set(slack, 3 * e);
    else if (t === t) {
      const i = 3 * Math.round(255 * Math.min(1, Math.max(0, t)));
      tint.set(colors.subarray(i, i + 3), 3 * e);
    } else {
      tint.fill(150, 3 * e, 3 * e + 3);
      if (!(looks[e] & 4)) unknown++;
    }
  }
  const color = new Uint8Array(4 * shape.count), style = new Uint8Array(4 * shape.count);
  const segments = shown.color === "tension" && model.get("segment_tension") ? model.row("segment_tension", shown.shot) : null;
  for (let s = 0; s < shape.count; s++) {
    const e = owner[s], kind = looks[e];
    for (let c = 0; c < 3; c++) color[4 * s + c] = tint[3 * e + c];
    color[4 * s + 3] = 255;
    style[4 * s] = kind & 4 || model.faceOf[e] >= 0 ? 0 : 10 * (kind & 1 ? Math.max(0.75 * width, 1) : width);
    style[4 * s + 1] = kind & 1 ? 255 : 0;
    const own = segments ? segments[shape.pieceOf[s]] : NaN;
    if (own !== own || kind & 5) continue;
    // a segment of a cable with friction: it can be slack beside taut ones
    const i = 3 * Math.round(255 * Math.min(1, Math.max(0, range.part(own)))), bare = own <= 0;
    color.set(bare ? slack : colors.subarray(i, i + 3), 4 * s);
    style.set([10 * (bare ? Math.max(0.75 * width, 1) : width), bare ? 255 : 0], 4 * s);
  }
  drawing.set("members", "lines", [drawable(shown.segments, looks), color, style]);
  faceLayers(look, looks, tint);
  casingLayer(look, looks, width);
  const count = bit => looks.reduce((n, l) => n + ((l & bit) && !(l & 4 && bit !== 4) ? 1 : 0), 0);
  const loose = count(1), pressed = count(2), absent = count(4);
  if (loose) keys.push([`slack (${loose} of ${model.nElem})`, { stroke: look.slack, dash: "6 4" }]);
  if (pressed) keys.push([`compression (${pressed})`, { casing: true, stroke: look.scale[8] }]);
  if (absent) keys.push([`${absent} inactive, not drawn`, {}]);
  const known = range && values.some(Number.isFinite);
  if (unknown && known) keys.push([`no value (${unknown})`, { stroke: "#969696" }]);
  showLegend(range, look.scale, !range || known ? "" : "only available at the end of a phase");
}

// Faces, in paler colors, and their edges: both behind the lines of other elements.
function faceLayers(look, looks, tint) {
  const corners = model.get("triangles"), face = model.get("face");
  if (!corners) return;
  const places = new Float32Array(3 * corners.length), color = new Uint8Array(4 * face.length), edges = [];
  face.forEach((e, t) => {
    for (let j = 0; j < 3; j++) {
      const at = 3 * corners[3 * t + j];
      places.set(looks[e] & 4 ? [NaN, NaN, NaN] : shown.nodes.subarray(at, at + 3), 9 * t + 3 * j);
      color[4 * t + j] = 0.7 * tint[3 * e + j] + 0.3 * 255 * look.ground[j];
    }
    color[4 * t + 3] = 255;
  });
  shape.owner.forEach((e, s) => { if (model.faceOf[e] >= 0 && !(looks[e] & 4)) edges.push(...shown.segments.subarray(6 * s, 6 * s + 6)); });
  const count = edges.length / 6, ink = look.ink.map(x => 255 * x);
  drawing.set("faces", "faces", [places, color], { lift: -4e-4 });
  drawing.set("edges", "lines", [new Float32Array(edges), fill(count, [...ink, 255]), fill(count, [8, 0, 0, 0])], { lift: -2e-4 });
}

// A dark rim along elements in compression: wider lines behind them.
function casingLayer(look, looks, width) {
  const lines = [];
  shape.owner.forEach((e, s) => { if ((looks[e] & 6) === 2) lines.push(...shown.segments.subarray(6 * s, 6 * s + 6)); });
  const count = lines.length / 6;
  drawing.set("casing", "lines", [new Float32Array(lines), fill(count, [...look.ink.map(x => 255 * x), 255]), fill(count, [10 * (width + Math.min(2.6, 1.2 * width)), 0, 0, 0])], { lift: -2e-3 });
}

// Segments of absent elements shrink to a point outside of the picture.
function drawable(segments, looks) {
  if (!looks.some(l => l & 4)) return segments;
  const out = segments.slice();
  shape.owner.forEach((e, s) => { if (looks[e] & 4) out.fill(NaN, 6 * s, 6 * s + 6); });
  return out;
}

function bent(own) { return model.get("bend") ? shape.summed("bend", own) : null; }

function axesLayer(look, own, keys) {
  if (!byId("axes").checked || !model.get("beam")) { drawing.hide("axes"); return; }
  const beams = model.get("beam"), bend = bent(own), axes = model.row("axes", shown.shot);
  const lines = [], colors = [];
  for (let k = 0; k < beams.length; k++) {
    if (!present(beams[k])) continue;
    const middle = shape.along(k, 0.5, shown.nodes, bend);
    const ends = [0, 1].map(x => shape.along(k, x, shown.nodes, bend));
    const size = Math.min(0.045 * shown.extent, 0.4 * Math.hypot(...ends[1].map((x, i) => x - ends[0][i])));
    for (const [j, color] of [[0, look.y], [1, look.z]]) {
      lines.push(...middle, ...middle.map((x, i) => x + size * axes[6 * k + 3 * j + i]));
      colors.push(...rgb(color), 255);
    }
  }
  drawing.set("axes", "lines", [new Float32Array(lines), new Uint8Array(colors), fill(lines.length / 6, [16, 0, 0, 0])], { lift: 1e-4 });
  keys.push(["section axis y", { stroke: look.y }], ["section axis z", { stroke: look.z }]);
}

// Diagrams of section forces at the ends of phases: strips beside the beams. Moments are on the side in
// tension: My is positive where that is +z, Mz where it is -y.
const DIAGRAMS = { N: [1, 1], Vy: [0, 1], Vz: [1, 1], T: [1, 1], My: [1, 1], Mz: [0, -1] };

function diagramLayer(look, own, keys) {
  const name = byId("diagram").value, at = Object.keys(DIAGRAMS).indexOf(name);
  const places = model.get("diagrams") ? model.shape("diagrams")[2] : 0, end = model.shots[shown.shot].endNumber;
  if (at < 0 || !places || end < 0) {
    drawing.hide("diagram");
    if (at >= 0) keys.push([`${name}: only at the end of a phase`, {}]);
    return;
  }
  const [axis, sign] = DIAGRAMS[name], beams = model.get("beam"), bend = bent(own), axes = model.row("axes", shown.shot);
  const all = model.row("diagrams", end), value = (k, j) => all[6 * (k * places + j) + at];
  let largest = 0;
  for (let k = 0; k < beams.length; k++) for (let j = 0; j < places; j++)
    if (present(beams[k])) largest = Math.max(largest, Math.abs(value(k, j)));
  const unit = at < 3 ? "N" : "N m", colors = [look.dark ? "#56b4e9" : "#0072b2", "#d55e00"], lines = [], tints = [];
  const scale = largest > 0 ? sign * 0.1 * shown.extent / largest : 0;
  for (let k = 0; k < beams.length; k++) {
    if (!present(beams[k])) continue;
    let before = null;
    for (let j = 0; j < places; j++) {
      const foot = shape.along(k, j / (places - 1), shown.nodes, bend), v = value(k, j);
      const tip = foot.map((x, i) => x + scale * v * axes[6 * k + 3 * axis + i]);
      const tint = [...rgb(colors[v < 0 ? 1 : 0]), 255];
      lines.push(...foot, ...tip);
      tints.push(...tint);
      if (before) { lines.push(...before, ...tip); tints.push(...tint); }
      before = tip;
    }
  }
  drawing.set("diagram", "lines", [new Float32Array(lines), new Uint8Array(tints), fill(lines.length / 6, [11, 0, 0, 0])]);
  keys.push([`largest ${name} ${withUnit(largest, unit, 3)}`, {}], ["positive", { stroke: colors[0] }], ["negative", { stroke: colors[1] }]);
}

// Arrows of loads end at their nodes, those of reactions begin there; the longest ones are a tenth
// of the structure, and shorter where there are many.
function arrowLayers(look, keys) {
  const end = model.shots[shown.shot].endNumber;
  const known = (id, name) => (byId(id).checked && end >= 0 ? model.row(name, end) : null);
  arrows("loads", known("loads", "load"), model.get("loaded"), true, look.load, keys);
  arrows("reactions", known("reactions", "reactions"), model.get("held"), false, look.reaction, keys);
  const wanted = ["loads", "reactions"].filter(id => byId(id).checked);
  if (end < 0 && wanted.length) keys.push([`${wanted.join(", ")}: only at the end of a phase`, {}]);
}

function arrows(name, forces, nodes, push, color, keys) {
  const sizes = forces ? Array.from(nodes, (_, k) => Math.hypot(forces[3 * k], forces[3 * k + 1], forces[3 * k + 2])) : [];
  const largest = sizes.reduce((a, b) => Math.max(a, b), 0);
  if (!(largest > 0)) { drawing.hide(name); drawing.hide(`${name} heads`); return; }
  const many = sizes.filter(x => x > 1e-7 * largest).length, ends = [];
  const scale = shown.extent * Math.min(0.1, 0.8 / Math.sqrt(many)) / largest;
  for (let k = 0; k < nodes.length; k++) {
    if (sizes[k] <= 1e-7 * largest) continue;
    const at = [0, 1, 2].map(i => shown.nodes[3 * nodes[k] + i]), by = [0, 1, 2].map(i => scale * forces[3 * k + i]);
    const [tail, tip] = push ? [at.map((x, i) => x - by[i]), at] : [at, at.map((x, i) => x + by[i])];
    ends.push(...tail, ...tip);
  }
  const count = ends.length / 6, both = new Float32Array(ends), tint = fill(count, [...rgb(color), 255]);
  drawing.set(name, "lines", [both, tint, fill(count, [10 * Math.min(1.8, Math.max(0.8, 1.8 * Math.sqrt(60 / count))), 0, 0, 0])], { lift: 2e-3 });
  drawing.set(`${name} heads`, "heads", [both, tint], { lift: 2e-3 });
  keys.push([`largest ${name.slice(0, -1)} ${withUnit(largest, "N", 3)}`, { arrow: color }]);
}

function markLayers(keys) {
  // supports of the phase: known for every phase that has an end
  const ends = model.shots.filter(s => s.end), phase = model.shots[shown.shot].phase;
  const kinds = model.row("supports", ends.findIndex(s => s.phase === phase));
  const some = byId("supports").checked && kinds.some(k => k > 0);
  if (some) {
    // of held nodes only: a mark costs its pixels even where it draws none
    const held = [...kinds.keys()].filter(k => kinds[k] > 0), points = Math.min(13, Math.max(5, 13 * Math.sqrt(60 / held.length)));
    const at = new Float32Array(3 * held.length);
    held.forEach((k, i) => at.set(shown.nodes.subarray(3 * k, 3 * k + 3), 3 * i));
    drawing.set("supports", "marks", [at, Float32Array.from(held, k => kinds[k])], { points, lift: 2e-4 });
    ["clamped", "pinned", "partially supported"].forEach((name, k) => { if (kinds.includes(k + 1)) keys.push([name, { mark: k + 1 }]); });
  } else drawing.hide("supports");
  if (byId("nodes").checked) drawing.set("nodes", "marks", [shown.nodes, new Float32Array(model.nNode).fill(4)], { points: 2.5 * lineWidth(), lift: 1e-4 });
  else drawing.hide("nodes");
}

function pickedLayer(look) {
  const picked = shown.picked;
  drawing.hide("picked");
  drawing.hide("picked node");
  if (!picked) return;
  if (picked.kind === "node") {
    const at = shown.nodes.slice(3 * picked.number, 3 * picked.number + 3);
    drawing.set("picked node", "marks", [at, new Float32Array([5])], { points: 18, depth: false });
    return;
  }
  const lines = [];
  shape.owner.forEach((e, s) => { if (e === picked.number) lines.push(...shown.segments.subarray(6 * s, 6 * s + 6)); });
  const count = lines.length / 6, accent = look.accent.map(x => 255 * x);
  drawing.set("picked", "lines", [new Float32Array(lines), fill(count, [...accent, 255]), fill(count, [10 * (lineWidth() + 5), 0, 0, 0])], { lift: model.faceOf[picked.number] < 0 ? -3e-3 : 1e-3 });
}

// --- time

// a phase within a sentence: "phase 2", or its own name
const named = phase => model.phases[phase - 1].replace(/^Phase (?=\d+$)/, "phase ");

function showTime() {
  const { phase, number, factor } = model.shots[shown.shot];
  byId("shot").value = shown.shot;
  byId("phase").value = phase;
  const place = model.repeats ? `${factor.toFixed(2)} of the amplitude` : `increment ${number}, load factor ${factor.toFixed(2)}`;
  const text = `${model.phases[phase - 1]}, ${place}`;
  byId("when").textContent = text;
  byId("shot").setAttribute("aria-valuetext", text);
}

function setShot(shot) {
  shown.shot = Math.min(lastShot, Math.max(0, shot));
  rebuild();
}

// The next instant of a mode, whose period begins again.
function nextInstant(shot) {
  const own = model.shots[shot].phase, next = model.shots[shot + 1];
  return next && next.phase === own ? shot + 1 : model.shots.findIndex(s => s.phase === own);
}

function play(on) {
  clearInterval(shown.playing);
  shown.playing = null;
  if (on && model.repeats) shown.playing = setInterval(() => setShot(nextInstant(shown.shot)), 60);
  else if (on && lastShot > 0) {
    if (shown.shot === lastShot) setShot(0);
    shown.playing = setInterval(() => {
      setShot(shown.shot + 1);
      if (shown.shot === lastShot) play(false);
    }, Math.min(250, Math.max(60, 4000 / (lastShot + 1))));
  }
  const button = byId("play"), playing = shown.playing !== null;
  button.textContent = playing ? "❚❚" : "▶";
  button.setAttribute("aria-label", playing ? "Pause" : "Play");
}

// --- the picture

let settled = 0;  // the timer after which all of it is drawn again

function moved() {
  clearTimeout(settled);
  settled = setTimeout(() => { settled = 0; request(); }, 200);
  request();
}

function request() {
  if (dirty) return;
  dirty = true;
  requestAnimationFrame(paint);
}

function aspect() { return canvas.clientWidth / Math.max(canvas.clientHeight, 1); }

function paint() {
  dirty = false;
  const turning = settled !== 0, ratio = Math.min(window.devicePixelRatio || 1, 2) * (turning ? 1 : drawing.fine);
  const [w, h] = [canvas.clientWidth, canvas.clientHeight].map(x => Math.max(1, Math.round(x * ratio)));
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  drawing.draw(camera.matrix(aspect()), { ...scene, ratio }, turning);
  showTriad(camera.directions());
}

function lookFrom(name) {
  camera.look(name, shown.nodes, aspect());
  request();
}

function pick(x, y, reach) {
  const seen = { node: k => nodeSeen[k], element: present };
  const nodeSeen = new Uint8Array(model.nNode), first = shape.pieces;
  shape.element.forEach((e, k) => { if (present(e)) nodeSeen[first[2 * k]] = nodeSeen[first[2 * k + 1]] = 1; });
  shown.picked = pickAt(x, y, reach, camera.matrix(aspect()), canvas.clientWidth, canvas.clientHeight,
    shown.nodes, shown.segments, shape.owner, seen, model.get("triangles") ?? [], model.get("face"));
  rebuild();
}

// --- mouse and fingers

const pointers = new Map();
let travelled = 0;

function spread() {
  const [a, b] = [...pointers.values()];
  return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
}

canvas.addEventListener("pointerdown", event => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
  if (pointers.size === 1) travelled = 0;
});

canvas.addEventListener("pointermove", event => {
  const own = pointers.get(event.pointerId);
  if (!own) return;
  const before = pointers.size === 2 ? spread() : null, [dx, dy] = [event.offsetX - own.x, event.offsetY - own.y];
  own.x = event.offsetX;
  own.y = event.offsetY;
  travelled += Math.hypot(dx, dy);
  if (before) {  // two fingers move and enlarge
    const after = spread(), h = canvas.clientHeight;
    camera.pan(after.x - before.x, after.y - before.y, h);
    camera.zoom(after.apart / Math.max(before.apart, 1), after.x - canvas.clientWidth / 2, after.y - h / 2, h);
  } else if (event.shiftKey || event.buttons & 6) camera.pan(dx, dy, canvas.clientHeight);
  else camera.orbit(dx, dy);
  moved();
});

for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => {
  const click = name === "pointerup" && pointers.size === 1 && travelled < 5 && event.button === 0;
  pointers.delete(event.pointerId);
  if (pointers.size > 0) travelled = Infinity;  // the last of several fingers is no click
  if (click) pick(event.offsetX, event.offsetY, event.pointerType === "touch" ? 16 : 8);
});

canvas.addEventListener("contextmenu", event => event.preventDefault());
canvas.addEventListener("wheel", event => {
  event.preventDefault();
  const factor = Math.exp(-0.0015 * event.deltaY * (event.deltaMode === 1 ? 20 : 1));
  camera.zoom(factor, event.offsetX - canvas.clientWidth / 2, event.offsetY - canvas.clientHeight / 2, canvas.clientHeight);
  moved();
}, { passive: false });

// --- keys

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

document.addEventListener("keydown", event => {
  // controls keep the keys that they know themselves
  const own = event.target.closest?.("input, select, button");
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (own && (event.key in ARROWS || event.key === " " || own.tagName === "SELECT")) return;
  if (event.key in ARROWS) {
    const [dx, dy] = ARROWS[event.key].map(x => 24 * x);
    event.shiftKey ? camera.pan(dx, dy, canvas.clientHeight) : camera.orbit(-dx, -dy);
    moved();
  } else if (event.key === "+" || event.key === "=") { camera.zoom(1.15); request(); }
  else if (event.key === "-") { camera.zoom(1 / 1.15); request(); }
  else if (event.key === "0") lookFrom("home");
  else if (event.key in AXES) lookFrom(event.key);
  else if (event.key === " ") play(shown.playing === null);
  else if (event.key === "Escape") { shown.picked = null; rebuild(); }
  else return;
  event.preventDefault();
});

// --- controls

function controls() {
  document.title = byId("title").textContent = model.title;
  byId("note").textContent = model.note ?? "";
  byId("note").hidden = !model.note;
  byId("color").append(...model.columns.map(c => option(c.label, c.label.replace(/_/g, " "))));
  byId("color").value = model.color;
  const ends = model.shots.flatMap((s, k) => (s.end ? [[k, s]] : [])).slice(0, -1);
  const past = model.repeats ? [] : ends.map(([k, s]) => option(k, `end of ${named(s.phase)}`));
  byId("reference").append(option(-1, model.repeats ? "at rest" : "initial geometry"), ...past);
  shown.reference = past.length ? ends[0][0] : -1;
  if (model.repeats) shown.shot = model.shots.findIndex(s => s.end);
  byId("reference").value = shown.reference;
  byId("phase").append(...model.shots.filter(s => s.end).map(s => option(s.phase, model.phases[s.phase - 1])));
  byId("diagram").append(option("", "none"), ...Object.keys(DIAGRAMS).map(name => option(name, name)));
  for (const node of document.querySelectorAll("[data-beams]")) node.hidden = !model.get("beam");
  byId("shot").max = lastShot;
  // of many members one sees no small difference, and pictures come twice as fast
  byId("ghost").checked = shape.count <= 3000;

  const on = (id, event, action) => byId(id).addEventListener(event, action);
  on("color", "change", () => { shown.color = byId("color").value; rebuild(); });
  on("reference", "change", () => { shown.reference = Number(byId("reference").value); rebuild(); });
  on("magnify", "input", () => {
    shown.magnify = Number((10 ** (byId("magnify").value / 50)).toPrecision(2));
    byId("magnify-value").textContent = shown.magnify;
    rebuild();
  });
  for (const id of ["own-range", "ghost", "nodes", "supports", "loads", "reactions", "axes", "diagram"]) on(id, "change", rebuild);
  on("flat", "change", () => { camera.flat = byId("flat").checked; request(); });
  on("shot", "input", () => { play(false); setShot(Number(byId("shot").value)); });
  on("phase", "change", () => { play(false); setShot(model.shots.findLastIndex(s => s.phase === Number(byId("phase").value))); });
  on("play", "click", () => play(shown.playing === null));
  on("picked-close", "click", () => { shown.picked = null; rebuild(); });
  on("theme", "click", () => {
    document.documentElement.dataset.theme = scene.dark ? "light" : "dark";
    rebuild();
  });
  on("menu", "click", () => {
    const open = byId("side").classList.toggle("open");
    byId("menu").setAttribute("aria-expanded", String(open));
  });
  for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => lookFrom(button.dataset.view));
  for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => { camera.zoom(Number(button.dataset.zoom)); request(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", rebuild);
  new ResizeObserver(request).observe(canvas);
}

function largestSize(points) {
  let most = 0;
  for (let k = 0; k < 3; k++) {
    let low = Infinity, high = -Infinity;
    for (let i = k; i < points.length; i += 3) { low = Math.min(low, points[i]); high = Math.max(high, points[i]); }
    most = Math.max(most, high - low);
  }
  return most;
}

// Waits until the picture is there: drawing only asks for it.
function finished() {
  const gl = drawing.gl;
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

try {
  drawing = new Drawing(canvas, shape.count);
  // layers in the order in which they are drawn
  for (const name of ["ghost", "picked", "casing", "members"]) drawing.set(name, "lines", [new Float32Array(0), new Uint8Array(0), new Uint8Array(0)]);
  controls();
  shown.extent = largestSize(shape.nodes([[lastShot, 1]])) || 1;
  rebuild();
  lookFrom("home");
  paint();
  // for scripts that drive the page, such as tests
  window.view = {
    model, camera, shown, paint, look: lookFrom,
    drawn: (finished(), performance.now()),  // ms since the page began to load
    place(kind, number) {  // in pixels of the canvas: of a node, or of the middle of an element
      const node = k => shown.nodes.subarray(3 * k, 3 * k + 3), triangle = model.faceOf[number];
      let at = node(number);
      if (kind === "element" && triangle >= 0) {
        const corners = [...model.row("triangles", triangle)].map(node);
        at = [0, 1, 2].map(i => (corners[0][i] + corners[1][i] + corners[2][i]) / 3);
      } else if (kind === "element") {
        const own = [...shape.owner.keys()].filter(s => shape.owner[s] === number), i = 6 * own[own.length >> 1];
        at = [0, 1, 2].map(k => own.length % 2 ? (shown.segments[i + k] + shown.segments[i + 3 + k]) / 2 : shown.segments[i + k]);
      }
      return onScreen(camera.matrix(aspect()), ...at, canvas.clientWidth, canvas.clientHeight);
    },
    turn() { camera.orbit(4, 0); moved(); paint(); finished(); },
  };
} catch (error) {
  byId("message").hidden = false;
  byId("message").textContent = error.message;
}
