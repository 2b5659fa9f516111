// The strip beside residential roads: where parking bays, pavements and lots lie. Found by rule from the kerbs, because no map
// of ours has them. Plane geometry; draws nothing.

import { along } from "./road_surface.js";

const STEP = 1.5; //: distance of the points at which a kerb is looked at [m]
const LEAST = 34; //: a stretch of kerb that is shorter gets no bay [m]
//: of a bay [m]: how deep it is, how far its ends are from those of the stretch, and how long they taper
export const BAY = { depth: 2.3, from: 9, taper: 4 };
//: pavement behind the kerb of a bay [m]: from and to
export const PAVEMENT = [1.3, 2.8];
//: what lies within this behind a kerb must be no road [m]
const REACH = 16;

/**
 * Stretches of residential kerb: each [{x, y, ux, uy, d}], at distances d [m] along it, with the road to the left of
 * (ux, uy). A kerb is residential where the road has one lane each way and nothing but ground behind it.
 */
export function residential(surface, kerbs, walks) {
  const found = [];
  for (const line of kerbs) {
    let run = [];
    const close = () => {
      if (run.length && run.at(-1).d - run[0].d >= LEAST) found.push(run.map((at) => ({ ...at, d: at.d - run[0].d })));
      run = [];
    };
    let [d, last] = [0, null];
    for (const at of along(line, STEP)) {
      if (last) d += Math.hypot(at.x - last.x, at.y - last.y);
      last = at;
      const bent = run.length && run.at(-1).ux * at.ux + run.at(-1).uy * at.uy < 0.9;
      if (bent || !quiet(surface, walks, at)) close();
      else run.push({ ...at, d });
    }
    close();
  }
  return found;
}

/** Whether the road at a point of a kerb has one lane each way, and there is neither road nor walkway behind it. */
function quiet(surface, walks, { x, y, ux, uy }) {
  const at = (in_) => [x - in_ * uy, y + in_ * ux];
  const own = laneAt(surface, ...at(0.6));
  if (!own || own.ux * ux + own.uy * uy < 0.9) return false;
  const other = laneAt(surface, ...at(own.width + 0.7));
  if (!other || other.ux * ux + other.uy * uy > -0.9) return false;
  if (surface.at(...at(own.width + other.width + 0.8))) return false;
  for (const out of [1.2, 3, 6, 9, 12, REACH]) if (surface.at(...at(-out))) return false;
  return !walks.some(({ points }) => points.some(([px, py]) => Math.hypot(px - x, py - y) < 6));
}

function laneAt(surface, x, y) {
  const there = surface.at(x, y);
  if (there?.lane === undefined) return null;
  const lane = surface.lanes[there.lane];
  return lane.kind === "road" ? { ux: there.ux, uy: there.uy, width: lane.width } : null;
}

/** How deep the bay of a stretch is at a distance along it [m]. */
export function bayDepth(run, d) {
  const long = run.at(-1).d;
  const inside = Math.min(d, long - d) - BAY.from;
  const t = Math.min(Math.max(inside / BAY.taper, 0), 1);
  return BAY.depth * t * t * (3 - 2 * t);
}

/** The point `out` metres behind the kerb of a stretch at a distance d along it, with the direction there. */
export function placeAt(run, d, out) {
  let k = run.findIndex((at) => at.d > d);
  if (k < 1) k = k === 0 ? 1 : run.length - 1;
  const [a, b] = [run[k - 1], run[k]];
  const share = (d - a.d) / (b.d - a.d || 1);
  const { ux, uy } = a;
  return { x: a.x + share * (b.x - a.x) + out * uy, y: a.y + share * (b.y - a.y) - out * ux, ux, uy };
}

/** The line `out(d)` metres behind the kerb of a stretch. */
export const lineAt = (run, out) => run.map(({ x, y, ux, uy, d }) => [x + out(d) * uy, y - out(d) * ux]);

/** The kerbs with those of bays in place of those of the stretches. */
export function kerbsWithBays(kerbs, runs) {
  const bays = runs.map((run) => lineAt(run, (d) => bayDepth(run, d)));
  const starts = new Map(runs.map((run, i) => [keyOf(run[0]), i]));
  const made = [...bays];
  for (const line of kerbs) made.push(...without(line, starts, runs));
  return made;
}

const keyOf = ({ x, y }) => `${x.toFixed(3)},${y.toFixed(3)}`;

/** The pieces of a kerb that belong to no stretch. */
function without(line, starts, runs) {
  const [pieces, points] = [[], [...along(line, STEP)]];
  let piece = [];
  for (let k = 0; k < points.length; k++) {
    const i = starts.get(keyOf(points[k]));
    piece.push([points[k].x, points[k].y]);
    if (i === undefined) continue;
    if (piece.length > 1) pieces.push(piece);
    k += runs[i].length - 1;
    piece = [[points[k].x, points[k].y]];
  }
  if (piece.length > 1) pieces.push(piece);
  return pieces;
}
