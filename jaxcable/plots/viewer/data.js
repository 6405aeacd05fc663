// What the page contains: a description in JSON, and arrays of numbers as one block of base64.

const TYPES = { f: Float32Array, u: Uint32Array, b: Uint8Array };

function bytesOf(base64) {
  const text = atob(base64.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

// The description with `get(name)`, an array or null, and `shape(name)`; blocks begin at multiples
// of four bytes, so that arrays are views of the block and nothing is copied.
function decode(description, base64) {
  const model = JSON.parse(description), block = bytesOf(base64).buffer, found = new Map();
  statedUnits = model.units || {};
  for (const [name, [type, offset, shape]] of Object.entries(model.arrays)) {
    const count = shape.reduce((a, b) => a * b, 1);
    found.set(name, new TYPES[type](block, offset, count));
  }
  model.get = name => found.get(name) ?? null;
  model.shape = name => model.arrays[name][2];
  model.nNode = model.shape("start")[0];
  model.nElem = model.shape("first")[0];
  // row i of an array [n, ...]
  model.row = (name, i) => {
    const width = model.shape(name).slice(1).reduce((a, b) => a * b, 1);
    return model.get(name).subarray(i * width, (i + 1) * width);
  };
  // ends of phases have more results than other increments: their number for every shot, or -1
  let ends = 0;
  for (const shot of model.shots) shot.endNumber = shot.end ? ends++ : -1;
  model.beamOf = numbered(model.get("beam"), model.nElem);
  model.sagOf = numbered(model.get("sagging"), model.shape("pieces")[0]);  // by piece: segments hang each
  model.faceOf = numbered(model.get("face"), model.nElem);
  let first = 0;
  for (const group of model.groups) { group.first = first; first += group.count; }
  return model;
}

// For every element (or piece) its place in a list of them, or -1.
function numbered(list, count) {
  const place = new Int32Array(count).fill(-1);
  if (list) list.forEach((number, k) => { place[number] = k; });
  return place;
}

// Factor and name of the unit in which numbers of an SI unit are shown, where the page states some.
let statedUnits = {};

// "12.35 kN": four or more digits, and a unit that suits; lengths stay in metres.
function withUnit(value, unit, digits = 5) {
  if (!Number.isFinite(value)) return "–";
  let name = unit;
  if (statedUnits[unit]) {
    value *= statedUnits[unit][0];
    name = statedUnits[unit][1];
  } else if (unit.startsWith("N")) {
    const [factor, prefix] = forceUnit(Math.abs(value), 1);
    value *= factor;
    name = prefix + unit.slice(1);
  }
  return `${short(value, digits)}${name === "-" ? "" : " " + name}`;
}

// Factor and name of a unit for forces up to `largest`, N.
function forceUnit(largest, many = 10) {
  if (largest >= many * 1e6) return [1e-6, "MN"];
  if (largest >= many * 1e3) return [1e-3, "kN"];
  return [1, "N"];
}

function short(value, digits) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replace("-", "−").replace("e-", "e−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}
