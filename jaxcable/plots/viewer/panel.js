// The texts of the page: legend, symbols, values of what is picked. Texts never are HTML.

const byId = id => document.getElementById(id);

function made(tag, text, attributes = {}) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

function option(value, text) { return made("option", text, { value }); }

// "axial force (kN), tension positive" and the range of the colors.
class Range {
  constructor(column, values, whole) {
    let low = Infinity, high = -Infinity;
    for (const v of values) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
    this.known = low <= high;
    if (!this.known) [low, high] = [0, 1];
    const name = column.label, signed = low < -1e-7 * Math.max(-low, high);
    this.factor = 1;
    let unit = column.unit;
    if (name === "utilization") {
      // begins at 0 and has 1 on it: colors show how far 1 is
      if (whole || high > 1) [low, high] = [0, Math.max(high, 1)];
      this.label = "force / breaking force (-)";
    } else {
      if (statedUnits[unit]) {
        [this.factor, unit] = statedUnits[unit];
      } else if (unit.startsWith("N")) {
        const [factor, force] = forceUnit(Math.max(-low, high));
        this.factor = factor;
        unit = force + unit.slice(1);
      }
      let text = name.replace(/_/g, " "), sign = "";
      if (name === "tension") [text, sign] = signed ? ["axial force", ", tension positive"] : ["tension", ""];
      this.label = `${text} (${unit})${sign}`;
    }
    if (high - low <= 1e-6 * Math.max(Math.abs(low), Math.abs(high), 1e-12)) {
      const width = Math.max(0.05 * Math.abs(high), 1e-3 / this.factor);
      [low, high] = [low - width, high + width];
    }
    this.low = low;
    this.high = high;
  }

  part(value) { return (value - this.low) / (this.high - this.low); }
}

function showLegend(range, scale, note) {
  byId("legend").hidden = !range;
  if (!range) return;
  byId("bar-name").textContent = range.label;
  byId("bar-colors").style.background = `linear-gradient(to right, ${scale.join(",")})`;
  byId("bar-ticks").replaceChildren(...[0, 0.5, 1].map(t => {
    const value = range.factor * (range.low + t * (range.high - range.low));
    const width = range.factor * (range.high - range.low);
    // as many digits as tell neighbouring ticks apart
    const digits = Math.max(0, Math.min(8, 2 - Math.floor(Math.log10(Math.max(width, 1e-12)))));
    return made("span", String(Number(value.toFixed(digits))).replace("-", "−"), { style: `left:${100 * t}%` });
  }));
  byId("bar-note").textContent = note;
}

const SVG = "http://www.w3.org/2000/svg";

function drawn(tag, attributes) {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  return node;
}

// Symbols: lines [text, { stroke, dash, casing }], arrows { arrow: color }, marks { mark: kind }.
function showKeys(entries) {
  byId("keys").replaceChildren(...entries.map(([text, look]) => {
    const item = made("li"), svg = drawn("svg", { viewBox: "0 0 26 12", "aria-hidden": "true" });
    const line = (color, width, dash) => svg.append(drawn("line", {
      x1: 1, x2: 25, y1: 6, y2: 6, stroke: color, "stroke-width": width, "stroke-dasharray": dash ?? "" }));
    if (look.casing) line("var(--ink)", 6);
    if (look.stroke) line(look.stroke, look.width ?? 2.4, look.dash);
    if (look.arrow) {
      line(look.arrow, 1.8);
      svg.append(drawn("path", { d: "M25 6 L17 2 L17 10 Z", fill: look.arrow }));
    }
    const shapes = { 1: "M9 2 H17 V10 H9 Z", 2: "M13 1 L18 11 H8 Z", 3: "M13 1 L18 11 H8 Z" };
    if (look.mark) svg.append(drawn("path", {
      d: shapes[look.mark], stroke: "var(--ink)", "stroke-width": 1.2,
      fill: look.mark === 3 ? "var(--ground)" : "var(--ink)" }));
    item.append(svg, made("span", text));
    return item;
  }));
}

function showTriad(directions) {
  const [right, up, back] = directions, triad = byId("triad");
  const axes = ["x", "y", "z"].map((name, k) => ({ name, at: [right[k], -up[k]], depth: back[k] }));
  axes.sort((a, b) => a.depth - b.depth);  // what is in front is drawn last
  triad.replaceChildren(...axes.flatMap(({ name, at: [x, y] }) => {
    const text = drawn("text", { x: 40 * x, y: 40 * y });
    text.textContent = name;
    const line = drawn("line", { x1: 0, y1: 0, x2: 29 * x, y2: 29 * y, stroke: "var(--soft)", "stroke-width": 2.5 });
    return Math.hypot(x, y) < 0.12 ? [line] : [line, text];
  }));
}

const vector = (values, unit) => Array.from(values, v => withUnit(v, unit)).join("\n");

// Rows [name, value] of an element at a shot; of a segment of it, where that has a tension of its own.
function elementRows(model, number, shot, piece) {
  const group = model.groups.findLast(g => g.first <= number);
  const looks = model.row("looks", shot)[number], end = model.shots[shot].endNumber;
  const rows = [["group", group.name || "(only group)"], ["number in its group", String(number - group.first)], ["kind", group.kind],
    ["nodes", `${model.get("first")[number]}, ${model.get("last")[number]}`]];
  rows.push(["state", looks & 4 ? "inactive" : looks & 1 ? "slack" : looks & 2 ? "compression" : model.faceOf[number] >= 0 ? "active" : "taut"]);
  let tension = NaN;  // the largest force is told where it differs
  for (const column of model.columns) {
    const value = model.row(column.array, shot)[number];
    if (column.label === "peak_tension" && value === tension) continue;
    if (column.label === "tension") tension = value;
    if (Number.isFinite(value)) rows.push([column.label.replace(/_/g, " "), withUnit(value, column.unit)]);
  }
  const own = model.get("segment_tension") && piece >= 0 ? model.row("segment_tension", shot)[piece] : NaN;
  if (Number.isFinite(own)) rows.push(["tension of this segment", withUnit(own, "N")]);
  if (end >= 0) {
    const length = model.row("rest_length", end)[number];
    if (Number.isFinite(length)) rows.push(["unstressed length", withUnit(length, "m", 7)]);
  }
  const beam = model.beamOf[number];
  if (beam >= 0 && end >= 0 && model.shape("diagrams")[2] > 0) {
    const width = 6 * model.shape("diagrams")[2], last = width - 6;
    const values = model.row("diagrams", end).subarray(beam * width, (beam + 1) * width);
    ["N", "Vy", "Vz", "T", "My", "Mz"].forEach((name, k) => {
      const unit = k < 3 ? "N" : "N m";
      rows.push([`${name} at both ends`, `${withUnit(values[k], unit)}\n${withUnit(values[last + k], unit)}`]);
    });
  }
  return { name: `Element ${number}`, rows };
}

function nodeRows(model, number, shot) {
  const start = model.get("start"), moved = model.row("moved", shot), i = 3 * number;
  const at = [0, 1, 2].map(k => model.origin[k] + start[i + k] + moved[i + k]);
  const rows = [["x, y, z", vector(at, "m")], ["displacement from the start", vector(moved.subarray(i, i + 3), "m")]];
  const phase = model.shots[shot].phase, before = model.shots.findLastIndex(s => s.phase < phase && s.end);
  if (before >= 0) {
    const then = model.row("moved", before);
    rows.push(["displacement in this phase", vector([0, 1, 2].map(k => moved[i + k] - then[i + k]), "m")]);
  }
  const end = model.shots[shot].endNumber;
  const loaded = model.get("loaded").indexOf(number), place = end >= 0 ? model.get("held").indexOf(number) : -1;
  if (end >= 0) {
    const load = loaded >= 0 ? model.row("load", end).subarray(3 * loaded, 3 * loaded + 3) : [0, 0, 0];
    rows.push(["load", vector(load, "N")]);
  }
  if (place >= 0) {
    rows.push(["reaction", vector(model.row("reactions", end).subarray(3 * place, 3 * place + 3), "N")]);
    if (model.get("reaction_moments"))
      rows.push(["reaction moment", vector(model.row("reaction_moments", end).subarray(3 * place, 3 * place + 3), "N m")]);
  }
  return { name: `Node ${number}`, rows };
}

function showPicked(model, picked, shot, shape) {
  byId("picked").hidden = !picked;
  if (!picked) return;
  const piece = picked.segment >= 0 ? shape.pieceOf[picked.segment] : -1;
  const { name, rows } = (picked.kind === "node" ? nodeRows : elementRows)(model, picked.number, shot, piece);
  byId("picked-name").textContent = name;
  byId("picked-values").replaceChildren(...rows.map(([key, value]) => {
    const row = made("tr");
    row.append(made("th", key, { scope: "row" }), made("td", value));
    return row;
  }));
}
