// Where one looks from: a turntable with z up, perspective or parallel.

const OPENING = 2 * Math.tan(Math.PI / 15);  // height over distance of what is seen: 24 degrees
const HOME = [-0.92, 0.42];                  // azimuth and elevation, rad
const AXES = { x: [0, 0], y: [-Math.PI / 2, 0], z: [-Math.PI / 2, Math.PI / 2] };

class Camera {
  constructor() {
    [this.azimuth, this.elevation] = HOME;
    this.target = [0, 0, 0];
    this.span = 1;        // height of what is seen at the target, m
    this.radius = 1;      // of the structure, m: limits of depth
    this.flat = false;    // whether the user wants a parallel projection
    this.along = false;   // whether the view is along an axis, which is always parallel
  }

  // Right, up, and towards the eye.
  directions() {
    const [s, c] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    const [t, d] = [Math.sin(this.elevation), Math.cos(this.elevation)];
    return [[-s, c, 0], [-t * c, -t * s, d], [d * c, d * s, t]];
  }

  // Clip coordinates of positions: a matrix by columns. Depth is measured from the eye.
  matrix(aspect) {
    const [right, up, back] = this.directions(), t = this.target;
    const distance = this.span / OPENING, parallel = this.flat || this.along;
    const near = parallel ? distance - 4 * this.radius : Math.max(distance - 3 * this.radius, 0.02 * distance);
    const far = distance + 4 * this.radius;
    const rows = parallel
      ? [[right, 2 / (this.span * aspect), 0], [up, 2 / this.span, 0], [back, -2 / (far - near), (2 * distance - far - near) / (far - near)]]
      : [[right, 2 / (OPENING * aspect), 0], [up, 2 / OPENING, 0],
         [back, -(far + near) / (far - near), (distance * (far + near) - 2 * far * near) / (far - near)]];
    const last = parallel ? [back, 0, 1] : [back, -1, distance];
    const m = new Float32Array(16);
    [...rows, last].forEach(([direction, factor, constant], row) => {
      let shift = 0;
      for (let k = 0; k < 3; k++) {
        m[4 * k + row] = factor * direction[k];
        shift += direction[k] * t[k];
      }
      m[12 + row] = constant - factor * shift;
    });
    return m;
  }

  orbit(dx, dy) {  // by pixels: half a turn in some 500
    this.along = false;
    this.azimuth -= 0.0065 * dx;
    this.elevation = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.elevation + 0.0065 * dy));
  }

  pan(dx, dy, height) {
    const [right, up] = this.directions(), metres = this.span / height;
    for (let k = 0; k < 3; k++) this.target[k] += metres * (-dx * right[k] + dy * up[k]);
  }

  // Enlarge about a place that is (x, y) pixels right of and below the middle: it stays there.
  zoom(factor, x = 0, y = 0, height = 1) {
    const least = 1e-4 * this.radius, most = 40 * this.radius;
    const span = Math.min(most, Math.max(least, this.span / factor));
    this.pan(-x, -y, height);
    this.span = span;
    this.pan(x, y, height);
  }

  // Look at all points from a direction, "home", "x", "y" or "z".
  look(name, points, aspect) {
    [this.azimuth, this.elevation] = AXES[name] ?? HOME;
    this.along = name in AXES;
    const directions = this.directions(), low = [Infinity, Infinity, Infinity], high = low.map(x => -x);
    for (let i = 0; i < points.length; i += 3) {
      for (let k = 0; k < 3; k++) {
        const d = directions[k], x = d[0] * points[i] + d[1] * points[i + 1] + d[2] * points[i + 2];
        if (x < low[k]) low[k] = x;
        if (x > high[k]) high[k] = x;
      }
    }
    const middle = low.map((x, k) => 0.5 * (x + high[k])), size = low.map((x, k) => high[k] - x);
    this.target = [0, 1, 2].map(k => directions.reduce((sum, d, j) => sum + d[k] * middle[j], 0));
    this.radius = Math.max(0.5 * Math.hypot(...size), 1e-6);
    this.span = Math.max(size[1], size[0] / aspect, 1e-3 * this.radius);
    // in perspective what is nearer looks larger: a few corrections until all of it fits
    for (let round = 0; round < 4; round++) this.fit(points, aspect);
  }

  fit(points, aspect) {
    const m = this.matrix(aspect), low = [Infinity, Infinity], high = [-Infinity, -Infinity];
    for (let i = 0; i < points.length; i += 3) {
      const p = onScreen(m, points[i], points[i + 1], points[i + 2], 2, 2);
      for (let k = 0; p && k < 2; k++) {
        low[k] = Math.min(low[k], p[k]);
        high[k] = Math.max(high[k], p[k]);
      }
    }
    if (!(low[0] <= high[0])) return;
    // the picture is 2 by 2 here, so that a pixel across is as wide as the aspect
    this.pan(aspect * (1 - 0.5 * (low[0] + high[0])), 1 - 0.5 * (low[1] + high[1]), 2);
    this.span = Math.max(1.26 * this.span * Math.max(high[0] - low[0], high[1] - low[1]) / 2, 1e-3 * this.radius);
  }
}
