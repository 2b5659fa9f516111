// Where there is road: lanes as strips about their centre lines, junctions as outlines. Answers what lies at a point, by
// which the borders of the road are found: kerbs where there is nothing beside a lane, marks where there is a lane.

const CELL = 8; //: side of a cell of the search grid [m]

/** Unit normals to the left of a line's points, shared between the pieces that meet there. */
export function leftNormals(points) {
  return points.map((_, i) => {
    const before = points[Math.max(i - 1, 0)];
    const after = points[Math.min(i + 1, points.length - 1)];
    const first = direction(before, points[i]);
    const second = direction(points[i], after);
    const [x, y] = [(first[0] || 0) + (second[0] || 0), (first[1] || 0) + (second[1] || 0)];
    const size = Math.hypot(x, y) || 1;
    const [ux, uy] = [x / size, y / size];
    // At a bend the border is farther than half the width: at most twice, so that a hairpin makes no spike.
    const known = first[0] !== undefined ? first : second;
    const bend = Math.max(ux * known[0] + uy * known[1], 0.5);
    return [-uy / bend, ux / bend];
  });
}

function direction(from, to) {
  const [x, y] = [to[0] - from[0], to[1] - from[1]];
  const long = Math.hypot(x, y);
  return long > 1e-9 ? [x / long, y / long] : [];
}

/** The line at a distance to the left of another, both as points [x, y]. */
export function beside(points, distance) {
  const normals = leftNormals(points);
  return points.map(([x, y], i) => [x + distance * normals[i][0], y + distance * normals[i][1]]);
}

/** The points of a line without those that repeat the one before. */
export function cleaned(points) {
  return points.filter(([x, y], i) => i === 0 || Math.hypot(x - points[i - 1][0], y - points[i - 1][1]) > 0.02);
}

/** Yield points along a line, at most `step` apart, each with the direction there. */
export function* along(points, step) {
  for (let i = 0; i + 1 < points.length; i++) {
    const [[ax, ay], [bx, by]] = [points[i], points[i + 1]];
    const long = Math.hypot(bx - ax, by - ay);
    if (long < 1e-6) continue;
    const pieces = Math.max(1, Math.ceil(long / step));
    const [ux, uy] = [(bx - ax) / long, (by - ay) / long];
    for (let k = 0; k < pieces; k++) yield { x: ax + (ux * long * k) / pieces, y: ay + (uy * long * k) / pieces, ux, uy };
    if (i + 2 === points.length) yield { x: bx, y: by, ux, uy };
  }
}

export class RoadSurface {
  /** `lanes` [{points, width, kind}] for vehicles, `outlines` of junctions [[x, y], …]. */
  constructor(lanes, outlines) {
    this.lanes = lanes;
    this.outlines = outlines;
    this.cells = new Map();
    lanes.forEach((lane, index) => {
      for (let i = 0; i + 1 < lane.points.length; i++) {
        const [a, b] = [lane.points[i], lane.points[i + 1]];
        this.#file([a, b], lane.width / 2 + 1, { lane: index, piece: i });
      }
    });
    outlines.forEach((points, index) => this.#file(points, 1, { outline: index }));
  }

  #file(points, reach, entry) {
    const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
    const first = [Math.min(...xs) - reach, Math.min(...ys) - reach].map((v) => Math.floor(v / CELL));
    const last = [Math.max(...xs) + reach, Math.max(...ys) + reach].map((v) => Math.floor(v / CELL));
    for (let i = first[0]; i <= last[0]; i++) {
      for (let j = first[1]; j <= last[1]; j++) {
        const key = i * 100003 + j;
        if (!this.cells.has(key)) this.cells.set(key, []);
        this.cells.get(key).push(entry);
      }
    }
  }

  /**
   * What covers a point but the lane `own`: {lane, ux, uy} of the nearest lane whose strip, widened by `slack`, holds
   * it, {outline} of a junction, or null.
   */
  at(x, y, { own = -1, ownOutline = -1, slack = 0 } = {}) {
    let found = null;
    let least = Infinity;
    for (const entry of this.cells.get(Math.floor(x / CELL) * 100003 + Math.floor(y / CELL)) ?? []) {
      if (entry.outline !== undefined) {
        if (!found && entry.outline !== ownOutline && inside(this.outlines[entry.outline], x, y)) found = entry;
        continue;
      }
      if (entry.lane === own) continue;
      const lane = this.lanes[entry.lane];
      const near = nearest(lane.points[entry.piece], lane.points[entry.piece + 1], x, y);
      if (near.distance <= lane.width / 2 + slack && near.distance < least) {
        least = near.distance;
        found = { lane: entry.lane, ux: near.ux, uy: near.uy };
      }
    }
    return found;
  }

  /** Whether there is road within a distance of a point [m]. */
  near(x, y, distance) {
    for (let i = 0; i < 8; i++) {
      const [c, s] = [Math.cos((i * Math.PI) / 4), Math.sin((i * Math.PI) / 4)];
      if (this.at(x + distance * c, y + distance * s) || this.at(x + 0.5 * distance * c, y + 0.5 * distance * s)) return true;
    }
    return this.at(x, y) !== null;
  }
}

function nearest([ax, ay], [bx, by], x, y) {
  const [dx, dy] = [bx - ax, by - ay];
  const square = dx * dx + dy * dy;
  const t = square > 0 ? Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / square, 0), 1) : 0;
  const long = Math.sqrt(square) || 1;
  return { distance: Math.hypot(x - ax - t * dx, y - ay - t * dy), ux: dx / long, uy: dy / long };
}

/** Whether a point lies inside an outline. */
export function inside(points, x, y) {
  let odd = false;
  for (let i = 0, j = points.length - 1; i < points.length; j = i++) {
    const [[ax, ay], [bx, by]] = [points[i], points[j]];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) odd = !odd;
  }
  return odd;
}

/** Twice the area of an outline, positive where it runs counter-clockwise [m2]. */
export function turning(points) {
  return points.reduce((sum, [x, y], i) => {
    const [u, v] = points[(i + 1) % points.length];
    return sum + x * v - u * y;
  }, 0);
}

/** The convex outline around points, counter-clockwise. */
export function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (list) => {
    const chain = [];
    for (const p of list) {
      while (chain.length > 1 && cross(chain.at(-2), chain.at(-1), p) <= 0) chain.pop();
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

const cross = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
