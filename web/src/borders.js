// Finds the borders of a road surface: where kerbs stand, and which marks lie between lanes.

import { along, beside, turning } from "./road_surface.js";

const STEP = 1.5; //: distance of the points at which a border is looked at [m]
const PROBE = 0.45; //: a gap between lanes that is narrower than this is no border [m]

/**
 * Lines of a road surface: `kerbs` [[x, y], …] with the road to their left, `centres` beside traffic that comes towards
 * one, `dividers` between lanes of one direction.
 */
export function borders(surface) {
  const found = { kerbs: [], centres: [], dividers: [] };
  surface.lanes.forEach((lane, own) => {
    // A lane inside a junction borders on other lanes and on the junction's outline, which has the kerbs.
    if (lane.kind === "junction") return;
    for (const side of [-1, 1]) {
      const edge = beside(lane.points, (side * lane.width) / 2);
      const line = side < 0 ? edge : [...edge].reverse();
      sort(line, (at) => laneBorder(surface, lane, own, side, at), found);
    }
  });
  surface.outlines.forEach((points, ownOutline) => {
    const closed = [...points, points[0]];
    // The road is to be on the left: a counter-clockwise outline has its inside there.
    const line = turning(points) > 0 ? closed : closed.reverse();
    sort(line, (at) => (surface.at(at.x + PROBE * at.uy, at.y - PROBE * at.ux, { ownOutline, slack: 0.1 }) ? null : "kerbs"), found);
  });
  return found;
}

/** The kind of border at a point of a lane's edge, the lane on the left of it; null for none. */
function laneBorder(surface, lane, own, side, { x, y, ux, uy }) {
  const there = surface.at(x + PROBE * uy, y - PROBE * ux, { own, slack: 0.1 });
  if (!there) return insideOutline(surface, x, y, ux, uy) ? null : "kerbs";
  if (there.lane === undefined) return null;
  const other = surface.lanes[there.lane];
  if (other.kind !== "road") return null;
  // The edge runs with the lane on its right side and against it on its left.
  const parallel = (there.ux * ux + there.uy * uy) * (side < 0 ? 1 : -1);
  if (parallel < -0.94) return "centres";
  return parallel > 0.94 && side > 0 ? "dividers" : null;
}

/** Whether a lane's edge lies inside a junction, whose outline then has the kerb. */
function insideOutline(surface, x, y, ux, uy) {
  const there = surface.at(x - 0.3 * uy, y + 0.3 * ux, { own: -2 });
  return there?.outline !== undefined;
}

/** Cut a line where the kind of border changes, and add the pieces to those of their kind. */
function sort(line, kindAt, found) {
  let [kind, piece] = [null, []];
  const close = () => {
    if (kind && piece.length > 1) found[kind].push(piece);
  };
  for (const at of along(line, STEP)) {
    const here = kindAt(at);
    if (here !== kind) {
      // A piece reaches to the point at which the next begins, so that kerbs meet.
      if (kind) piece.push([at.x, at.y]);
      close();
      piece = [];
      kind = here;
    }
    if (kind) piece.push([at.x, at.y]);
  }
  close();
}

/** A line without the points that lie on the straight line between their neighbours. */
export function straightened(line, tolerance = 0.01) {
  const kept = [line[0]];
  for (let i = 1; i + 1 < line.length; i++) {
    const [[ax, ay], [bx, by], [cx, cy]] = [kept.at(-1), line[i], line[i + 1]];
    const long = Math.hypot(cx - ax, cy - ay) || 1;
    if (Math.abs((cx - ax) * (by - ay) - (cy - ay) * (bx - ax)) / long > tolerance || long > 60) kept.push([bx, by]);
  }
  kept.push(line.at(-1));
  return kept;
}

/** Cut a line into dashes of some length with some gap [m]. */
export function dashes(line, length, gap) {
  const made = [];
  let [walked, dash] = [0, []];
  for (let i = 0; i + 1 < line.length; i++) {
    const [[ax, ay], [bx, by]] = [line[i], line[i + 1]];
    const long = Math.hypot(bx - ax, by - ay);
    let at = 0;
    while (at < long - 1e-9) {
      const phase = walked % (length + gap);
      const on = phase < length;
      const step = Math.min(long - at, (on ? length : length + gap) - phase + 1e-9);
      const point = (d) => [ax + ((bx - ax) * d) / long, ay + ((by - ay) * d) / long];
      if (on) {
        if (!dash.length) dash.push(point(at));
        dash.push(point(at + step));
      }
      at += step;
      walked += step;
      if (on && walked % (length + gap) >= length) {
        made.push(dash);
        dash = [];
      }
    }
  }
  if (dash.length > 1) made.push(dash);
  return made;
}
