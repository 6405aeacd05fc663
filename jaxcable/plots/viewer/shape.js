// Where the elements are: straight pieces, cubics of bent beams, hanging cables.

const PARTS = 8;  // straight parts of a bent beam

class Shape {
  constructor(model) {
    this.model = model;
    const pieces = model.get("pieces"), element = model.get("element");
    this.sagPlaces = model.get("sag") ? model.shape("sag")[2] : 0;
    this.endShots = model.shots.flatMap((shot, k) => (shot.end ? [k] : []));
    // pieces that are drawn as several segments, and the element of every segment
    this.parts = new Uint8Array(element.length).fill(1);
    element.forEach((e, k) => {
      if (model.beamOf[e] >= 0) this.parts[k] = PARTS;
      if (model.sagOf[k] >= 0) this.parts[k] = this.sagPlaces + 1;
    });
    this.count = this.parts.reduce((a, b) => a + b, 0);
    this.owner = new Uint32Array(this.count);
    this.pieceOf = new Uint32Array(this.count);
    let at = 0;
    this.parts.forEach((n, k) => {
      this.pieceOf.fill(k, at, at + n);
      this.owner.fill(element[k], at, at += n);
    });
    this.pieces = pieces;
    this.element = element;
  }

  // Weights of shots whose sum is what is shown: a shot, exaggerated from a reference (-1: start).
  // Everything that moves is linear in them: nodes, and what elements differ by from their chords.
  static weights(shot, reference, magnify) {
    if (shot < 0) return [];
    const own = [[shot, magnify]];
    if (reference >= 0 && magnify !== 1) own.push([reference, 1 - magnify]);
    return own;
  }

  // Positions of the nodes, [n_node * 3], m from the origin.
  nodes(weights) {
    const places = Float32Array.from(this.model.get("start"));
    for (const [shot, weight] of weights) {
      const moved = this.model.row("moved", shot);
      for (let i = 0; i < places.length; i++) places[i] += weight * moved[i];
    }
    return places;
  }

  // Sum of an array [n_shot, ...] by the weights.
  summed(name, weights) {
    const total = new Float32Array(this.model.shape(name).slice(1).reduce((a, b) => a * b, 1));
    for (const [shot, weight] of weights) {
      const row = this.model.row(name, shot);
      for (let i = 0; i < total.length; i++) total[i] += weight * row[i];
    }
    return total;
  }

  // Shapes of hanging cables are known at the ends of phases: weights of these for a sum of shots.
  sagWeights(weights) {
    const ends = this.endShots, found = [];
    let total = 0;
    for (const [shot, weight] of weights) {
      total += weight;
      const next = Math.max(ends.findIndex(k => k >= shot), 0);
      const part = next === 0 || ends[next] === shot ? 1 : this.model.shots[shot].factor / this.model.shots[ends[next]].factor;
      found.push([next, weight * part]);
      if (part < 1) found.push([next - 1, weight * (1 - part)]);
    }
    // nothing is known of the start: there they hang as at the end of the first phase
    if (Math.abs(total - 1) > 1e-9) found.push([0, 1 - total]);
    return found;
  }

  // Ends of all segments, [n_segment * 6].
  segments(weights, places = this.nodes(weights)) {
    const { pieces, element, parts, model } = this, out = new Float32Array(6 * this.count);
    const bend = model.get("bend") && this.summed("bend", weights);
    const sag = this.sagPlaces ? this.summed("sag", this.sagWeights(weights)) : null;
    let at = 0;
    const point = [0, 0, 0];
    for (let k = 0; k < element.length; k++) {
      const a = 3 * pieces[2 * k], b = 3 * pieces[2 * k + 1], n = parts[k];
      const beam = model.beamOf[element[k]], hanging = model.sagOf[k];
      for (let j = 0; j <= n; j++) {
        const x = j / n;
        for (let i = 0; i < 3; i++) point[i] = (1 - x) * places[a + i] + x * places[b + i];
        if (beam >= 0) addCubic(point, bend, 6 * beam, x);
        else if (hanging >= 0 && j > 0 && j < n) {
          const from = 3 * (hanging * this.sagPlaces + j - 1);
          for (let i = 0; i < 3; i++) point[i] += sag[from + i];
        }
        if (j > 0) { out.set(point, at + 3); at += 6; }
        if (j < n) out.set(point, at);
      }
    }
    return out;
  }

  // Positions along a beam at places x from 0 to 1.
  along(beam, x, places, bend) {
    const e = this.model.get("beam")[beam];
    const a = 3 * this.model.get("first")[e], b = 3 * this.model.get("last")[e];
    const point = [0, 1, 2].map(i => (1 - x) * places[a + i] + x * places[b + i]);
    addCubic(point, bend, 6 * beam, x);
    return point;
  }
}

// Distance of a beam from its chord at x: Hermite's cubic with the slopes at both ends.
function addCubic(point, bend, from, x) {
  const first = x * (1 - x) * (1 - x), second = -x * x * (1 - x);
  for (let i = 0; i < 3; i++) point[i] += first * bend[from + i] + second * bend[from + 3 + i];
}
