// WebGL 2: lines of a width in pixels, heads of arrows, triangles, and symbols at points.
// What turns is a matrix: the corners of every line are made of its ends in the vertex shader. They
// are vertices of their own and no instances, which software renderers draw one by one.

const LINES = `#version 300 es
layout(location=0) in vec3 a;
layout(location=1) in vec3 b;
layout(location=2) in vec4 colour;
layout(location=3) in vec4 style;    // width in px / 25.5, dashed, -, -
uniform mat4 matrix;
uniform vec2 size;                   // of the canvas, device px
uniform float ratio;                 // device px per px
uniform float lift;                  // towards the eye, of the depth
out vec4 tint;
out vec3 place;                      // across, along (px), length (px)
out vec2 look;                       // half width, dashed
void main() {
  int number = gl_VertexID & 3;      // along 0 or 1, across -1 or 1
  vec2 corner = vec2(number & 1, number & 2) - vec2(0.0, 1.0);
  vec4 p = matrix * vec4(a, 1.0), q = matrix * vec4(b, 1.0);
  float near = 1e-5;                 // what is behind the eye has no place in the picture
  if (p.w < near && q.w < near) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  if (p.w < near) p = mix(p, q, (near - p.w) / (q.w - p.w));
  if (q.w < near) q = mix(q, p, (near - q.w) / (p.w - q.w));
  vec2 s = 0.5 * size * p.xy / p.w, d = 0.5 * size * q.xy / q.w - s;
  float len = length(d);
  d = len > 1e-6 ? d / len : vec2(1.0, 0.0);
  float wide = 0.5 * ratio * 25.5 * style.x;
  vec2 off = wide * (vec2(-d.y, d.x) * corner.y + d * (2.0 * corner.x - 1.0));
  vec4 here = corner.x < 0.5 ? p : q;
  gl_Position = here;
  gl_Position.xy += 2.0 * off / size * here.w;
  gl_Position.z -= lift * here.w;
  tint = colour;
  place = vec3(wide * corner.y, corner.x * (len + 2.0 * wide) - wide, len);
  look = vec2(wide, style.y);
}`;

const LINES_INSIDE = `#version 300 es
precision highp float;
in vec4 tint;
in vec3 place;
in vec2 look;
uniform float ratio;
out vec4 pixel;
void main() {
  // round ends: pieces of a curve join without gaps
  float beyond = max(max(-place.y, place.y - place.z), 0.0);
  if (beyond > 0.0 && beyond * beyond + place.x * place.x > look.x * look.x) discard;
  if (look.y > 0.5 && fract(place.y / (9.0 * ratio)) > 0.58) discard;
  pixel = tint;
}`;

// The same lines a pixel wide, of two vertices each: a quarter of the time in software renderers.
const THIN = `#version 300 es
layout(location=0) in vec3 at;
layout(location=1) in vec4 colour;
uniform mat4 matrix;
uniform float lift;
out vec4 tint;
void main() {
  gl_Position = matrix * vec4(at, 1.0);
  gl_Position.z -= lift * gl_Position.w;
  tint = colour;
}`;

const HEADS = `#version 300 es
layout(location=0) in vec3 a;
layout(location=1) in vec3 b;
layout(location=2) in vec4 colour;
uniform mat4 matrix;
uniform vec2 size;
uniform float ratio;
uniform float lift;
out vec4 tint;
void main() {
  int number = gl_VertexID % 3;      // both ends of the base, and the tip
  vec2 corner = vec2(number == 2 ? 1.0 : 0.0, number == 2 ? 0.0 : number == 0 ? -1.0 : 1.0);
  vec4 p = matrix * vec4(a, 1.0), q = matrix * vec4(b, 1.0);
  vec2 d = 0.5 * size * (q.xy / q.w - p.xy / p.w);
  float len = length(d), head = min(10.0 * ratio, 0.6 * len);
  d = len > 1e-6 ? d / len : vec2(1.0, 0.0);
  vec2 off = head * (-(1.0 - corner.x) * d + 0.38 * corner.y * vec2(-d.y, d.x));
  gl_Position = q;
  gl_Position.xy += 2.0 * off / size * q.w;
  gl_Position.z -= lift * q.w;
  tint = colour;
}`;

const PLAIN_INSIDE = `#version 300 es
precision highp float;
in vec4 tint;
out vec4 pixel;
void main() { pixel = tint; }`;

const MARKS = `#version 300 es
layout(location=0) in vec3 at;
layout(location=1) in float kind;
uniform mat4 matrix;
uniform float points;
uniform float lift;
flat out int shape;
void main() {
  gl_Position = matrix * vec4(at, 1.0);
  gl_Position.z -= lift * gl_Position.w;
  gl_PointSize = points;
  shape = int(kind + 0.5);
}`;

// kinds: 0 none, 1 square (clamped), 2 triangle (pinned), 3 open triangle (in part), 4 disc, 5 ring
const MARKS_INSIDE = `#version 300 es
precision highp float;
flat in int shape;
uniform vec4 ink;
uniform vec4 ground;
uniform vec4 accent;
out vec4 pixel;
void main() {
  vec2 c = 2.0 * gl_PointCoord - 1.0;
  if (shape == 0) discard;
  if (shape == 1 && max(abs(c.x), abs(c.y)) > 0.72) discard;
  float side = 0.5 * (c.y + 1.0);                   // 0 at the top, 1 at the base
  if (shape == 2 || shape == 3) {
    if (abs(c.x) > 0.92 * side || c.y > 0.8) discard;
    bool rim = abs(c.x) > 0.92 * side - 0.3 || c.y > 0.55;
    pixel = shape == 3 && !rim ? ground : ink;
    return;
  }
  float r = length(c);
  if (shape == 4 && r > 0.8) discard;
  if (shape == 5) { if (r > 0.95 || r < 0.62) discard; pixel = accent; return; }
  pixel = ink;
}`;

// Whether pictures are computed without a graphics card, as on remote machines.
function isSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

class Drawing {
  constructor(canvas, count) {
    this.canvas = canvas;
    // smooth edges cost a software renderer three times the time: it has them up to some lines only
    const software = isSoftware(), antialias = count < 3000 || !software;
    // with more lines it has them at rest: a picture of twice the size, which the browser reduces
    this.fine = !antialias && count < 30000 ? 2 : 1;
    this.most = software ? 40000 : 1000000;  // lines that are drawn while the picture turns
    this.few = software ? 2000 : Infinity;   // up to so many lines of a layer keep their width then
    // preserved, so that a saved or copied picture of the page is not empty
    const gl = canvas.getContext("webgl2", { antialias, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2, which draws the structure.");
    this.gl = gl;
    this.lines = this.program(LINES, LINES_INSIDE);
    this.thin = this.program(THIN, PLAIN_INSIDE);
    this.heads = this.program(HEADS, PLAIN_INSIDE);
    this.faces = this.thin;
    this.marks = this.program(MARKS, MARKS_INSIDE);
    this.corners = new Map();
    this.layers = new Map();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
  }

  program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram(), names = {};
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS);
    for (let k = 0; k < count; k++) {
      const { name } = gl.getActiveUniform(program, k);
      names[name] = gl.getUniformLocation(program, name);
    }
    return { program, names };
  }

  // Vertices of every line: those of two triangles, or its two ends.
  indices(count, corners) {
    const gl = this.gl, key = `${corners.length} ${count}`;
    let buffer = this.corners.get(key);
    if (buffer) { gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer); return; }
    this.corners.set(key, buffer = gl.createBuffer());
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
    const each = 1 + Math.max(...corners), width = corners.length, list = new Uint32Array(width * count);
    // in an order of which every beginning is spread over all lines, for `draw` of some of them
    const step = 7919 % count || 1, order = new Uint32Array(count);
    for (let k = 0, line = 0; k < count; k++, line = (line + step) % count) order[k] = line;
    if (new Set(order).size < count) order.forEach((_, k) => { order[k] = k; });
    for (let k = 0; k < count; k++)
      for (let j = 0; j < width; j++) list[width * k + j] = each * order[k] + corners[j];
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
  }

  // Put lines (ends [n * 6], colours and styles [n * 4], bytes), triangles (corners [n * 9], colours
  // [n * 4]) or marks (places [n * 3], kinds [n]) under a name; layers are drawn in the order in which their names came first.
  set(name, kind, arrays, options = {}) {
    const gl = this.gl;
    let layer = this.layers.get(name);
    if (!layer) {
      layer = { kind, lift: 0, depth: true };
      this.layers.set(name, layer);
      const f = gl.FLOAT, bytes = arrays.slice(1).map((_, k) => [k + 1, 4, gl.UNSIGNED_BYTE, 0, 0]);
      if (kind === "marks") layer.own = this.bound(2, [[0, 3, f, 0, 0], [1, 1, f, 0, 0]]);
      else if (kind === "faces") layer.own = this.bound(2, [[0, 3, f, 0, 0], ...bytes]);
      else layer.own = this.bound(arrays.length, [[0, 3, f, 24, 0], [0, 3, f, 24, 12], ...bytes]);
      if (kind === "lines") layer.ends = this.bound(2, [[0, 3, f, 0, 0], [1, 4, gl.UNSIGNED_BYTE, 0, 0]]);
    }
    const times = { lines: 4, heads: 3, marks: 1, faces: 3 }[kind], width = { marks: 3, faces: 9 }[kind] ?? 6;
    const put = (buffer, values) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    };
    arrays.forEach((values, k) => put(layer.own.buffers[k], kind === "faces" && k === 0 ? values : repeated(values, k === 0 ? 6 : 4, times)));
    layer.count = arrays[0].length / width;
    layer.many = kind === "lines" && layer.count > this.few;
    if (layer.many) {
      put(layer.ends.buffers[0], arrays[0]);
      put(layer.ends.buffers[1], repeated(arrays[1], 4, 2));
    }
    Object.assign(layer, options);
  }

  // Buffers, and vertices with attributes [buffer, width, type, stride, offset] from them.
  bound(count, attributes) {
    const gl = this.gl, buffers = Array.from({ length: count }, () => gl.createBuffer()), vertices = gl.createVertexArray();
    gl.bindVertexArray(vertices);
    attributes.forEach(([buffer, width, type, stride, offset], location) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffers[buffer]);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, width, type, type === gl.UNSIGNED_BYTE, stride, offset);
    });
    gl.bindVertexArray(null);
    return { buffers, vertices };
  }

  hide(name) {
    const layer = this.layers.get(name);
    if (layer) layer.count = 0;
  }

  // While it turns, large structures are drawn in part: a share of the lines, without smooth motion
  // one would see nothing of them at all; and without a graphics card by lines of one pixel.
  draw(matrix, look, turning = false) {
    const { gl, canvas } = this, ratio = look.ratio;
    let lines = 0;
    for (const layer of this.layers.values()) if (layer.kind === "lines") lines += layer.count;
    const share = turning ? Math.min(1, this.most / Math.max(lines, 1)) : 1;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(...look.ground, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    for (const layer of this.layers.values()) {
      if (!layer.count) continue;
      const thin = turning && layer.many, { program, names } = thin ? this.thin : this[layer.kind];
      gl.useProgram(program);
      gl.uniformMatrix4fv(names.matrix, false, matrix);
      gl.uniform2f(names.size ?? null, canvas.width, canvas.height);
      gl.uniform1f(names.ratio ?? null, ratio);
      gl.uniform1f(names.lift ?? null, layer.lift);
      gl.uniform1f(names.points ?? null, (layer.points ?? 12) * ratio);
      gl.uniform4f(names.ink ?? null, ...look.ink, 1);
      gl.uniform4f(names.ground ?? null, ...look.ground, 1);
      gl.uniform4f(names.accent ?? null, ...look.accent, 1);
      gl.depthMask(!layer.behind);
      layer.depth ? gl.enable(gl.DEPTH_TEST) : gl.disable(gl.DEPTH_TEST);
      gl.bindVertexArray((thin ? layer.ends : layer.own).vertices);
      if (layer.kind === "marks") gl.drawArrays(gl.POINTS, 0, layer.count);
      else if (layer.kind === "heads" || layer.kind === "faces") gl.drawArrays(gl.TRIANGLES, 0, 3 * layer.count);
      else {
        const corners = thin ? [0, 1] : [0, 1, 2, 2, 1, 3];
        this.indices(layer.count, corners);
        gl.drawElements(thin ? gl.LINES : gl.TRIANGLES, corners.length * Math.ceil(share * layer.count), gl.UNSIGNED_INT, 0);
      }
    }
    gl.bindVertexArray(null);
    gl.depthMask(true);  // or the depths could not be cleared
  }
}

// Every row of an array, so many numbers wide, several times in a row.
function repeated(values, width, times) {
  if (times === 1) return values;
  // rows of four bytes are copied as one number
  const source = width === 4 ? new Uint32Array(values.buffer, values.byteOffset, values.length / 4) : values;
  const step = width === 4 ? 1 : width, out = new source.constructor(times * source.length);
  for (let i = 0, at = 0; i < source.length; i += step)
    for (let j = 0; j < times; j++) for (let k = 0; k < step; k++) out[at++] = source[i + k];
  return out;
}
