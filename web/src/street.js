// The street: ground, road surface, marks, kerbs, crossings, stop lines. All that is flat is painted one over the other in
// order, without depth: nothing lies below it. Kerbs are bodies.

import { BufferAttribute, BufferGeometry, Color, Group, Mesh, ShapeUtils, Vector2 } from "three";
import { borders, dashes, straightened } from "./borders.js";
import { RoadSurface, beside, cleaned, hull, leftNormals } from "./road_surface.js";
import { bodyMaterial, groundMaterial } from "./shading.js";
import { Neighbourhood } from "./neighbourhood.js";
import { Shape } from "./shapes.js";
import { BAY, PAVEMENT, bayDepth, kerbsWithBays, lineAt, residential } from "./verge.js";

const COLOURS = { grass: "#75875a", asphalt: "#55575a", walk: "#a9a59c", white: "#e4e4de", yellow: "#d9a521", kerb: "#b5b1a8", drive: "#9c9891" };
const KERB = { height: 0.13, width: 0.16 }; //: [m]
const MARK = 0.11; //: width of a line between lanes [m]
const [GROUND, PIECE] = [2500, 250]; //: half the side of the ground, and the side of its pieces [m]
const TILE = 250; //: side of the squares that are drawn or left out as one [m]
//: what is flat is drawn in this order, before all bodies, which have 0
const ORDER = { ground: -8, walk: -7, road: -6, marks: -5 };

/**
 * Everything of a scene that does not move and lies on the ground; with `surface`, the road that was found. A `dressed` one
 * has bays, pavements, houses and parked cars by rule where roads are residential: its `neighbourhood`.
 */
export function street(scene, reference, dressed = false) {
  const lanes = scene.lanes.map((lane) => ({ ...lane, width: lane.width ?? 3.2, points: cleaned(lane.points) }));
  const whole = lanes.filter((lane) => lane.points.length > 1);
  const driven = whole.filter(({ kind }) => kind === "road" || kind === "junction");
  const outlines = scene.network?.junctions?.map(({ points }) => points) ?? hulls(driven);
  const surface = new RoadSurface(driven, outlines);
  const lines = borders(surface);
  const runs = dressed ? residential(surface, lines.kerbs, whole.filter(({ kind }) => kind === "foot")) : [];
  const neighbourhood = dressed ? new Neighbourhood(scene, surface, runs, reference) : null;
  const group = new Group();
  group.add(
    ...groundPlane().meshes(groundMaterial({ fine: 0.017, rough: 0.36 }), ORDER.ground),
    ...walks(whole, runs, neighbourhood, reference).meshes(groundMaterial({ fine: 0.1, rough: 0.16 }), ORDER.walk),
    ...asphalt(driven, outlines, runs, reference).meshes(groundMaterial({ fine: 0.11, rough: 0.26 }), ORDER.road),
    ...marks(scene, whole, lines, reference).meshes(groundMaterial({ fine: 0.11, rough: 0.2 }), ORDER.marks),
    ...kerbs(dressed ? kerbsWithBays(lines.kerbs, runs) : lines.kerbs, reference),
  );
  if (neighbourhood) group.add(...neighbourhood.group.children);
  return { group, surface, neighbourhood };
}

/** Junctions' areas where no network says them: the convex outline of lanes inside junctions that touch each other. */
function hulls(lanes) {
  const inner = lanes.filter(({ kind }) => kind === "junction");
  const boxes = inner.map(({ points }) => [0, 1].map((k) => [Math.min(...points.map((p) => p[k])), Math.max(...points.map((p) => p[k]))]));
  const touch = (a, b) => [0, 1].every((k) => boxes[a][k][0] <= boxes[b][k][1] + 0.5 && boxes[b][k][0] <= boxes[a][k][1] + 0.5);
  const group = inner.map((_, i) => i);
  const root = (i) => (group[i] === i ? i : (group[i] = root(group[i])));
  for (let a = 0; a < inner.length; a++) for (let b = 0; b < a; b++) if (touch(a, b)) group[root(a)] = root(b);
  const clusters = new Map();
  inner.forEach((lane, i) => {
    const points = [-1, 1].flatMap((side) => beside(lane.points, (side * lane.width) / 2));
    clusters.set(root(i), [...(clusters.get(root(i)) ?? []), ...points]);
  });
  return [...clusters.values()].map(hull);
}

const tileOf = ([X, , Z]) => `${Math.floor(X / TILE)},${Math.floor(Z / TILE)}`;

/** What `tiles` holds for a key; made at first. */
function tileAt(tiles, key, make) {
  if (!tiles.has(key)) tiles.set(key, make());
  return tiles.get(key);
}

/** Triangles on the ground, each corner with a colour, filed by the tile of the first corner. */
class Paint {
  /** `tile` says of a corner in the scene which tile it is filed by. */
  constructor(reference, tile = tileOf) {
    this.reference = reference;
    this.tile = tile;
    this.tiles = new Map();
  }

  triangle(corners, colour) {
    const [a, b, c] = corners;
    const left = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    const placed = (left > 0 ? [a, b, c] : [a, c, b]).map(([x, y]) => this.reference.place(x, y));
    const tile = tileAt(this.tiles, this.tile(placed[0]), () => ({ positions: [], tints: [] }));
    const { r, g, b: blue } = new Color(colour);
    for (const corner of placed) {
      tile.positions.push(...corner);
      tile.tints.push(r, g, blue);
    }
  }

  /** A strip between two lines with as many points. */
  strip(left, right, colour) {
    for (let i = 0; i + 1 < left.length; i++) {
      this.triangle([right[i], right[i + 1], left[i + 1]], colour);
      this.triangle([right[i], left[i + 1], left[i]], colour);
    }
  }

  line(points, width, colour) {
    this.strip(beside(points, width / 2), beside(points, -width / 2), colour);
  }

  area(points, colour) {
    const corners = points.map(([x, y]) => new Vector2(x, y));
    for (const triangle of ShapeUtils.triangulateShape(corners, [])) this.triangle(triangle.map((i) => points[i]), colour);
  }

  meshes(material, order) {
    const kind = Object.keys(ORDER).find((name) => ORDER[name] === order);
    return [...this.tiles.values()].map(({ positions, tints }) => {
      const made = new BufferGeometry();
      made.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
      made.setAttribute("tint", new BufferAttribute(new Float32Array(tints), 3));
      const mesh = new Mesh(made, material);
      mesh.renderOrder = order;
      mesh.userData.kind = kind;
      return mesh;
    });
  }
}

function groundPlane() {
  const paint = new Paint({ place: (x, y) => [x, 0, -y] }, () => "whole");
  // In pieces: over a triangle of kilometres, depths are wrong by pixels where no graphics card draws.
  const steps = Array.from({ length: (2 * GROUND) / PIECE + 1 }, (_, k) => k * PIECE - GROUND);
  for (const y of steps.slice(1)) paint.strip(steps.map((x) => [x, y]), steps.map((x) => [x, y - PIECE]), COLOURS.grass);
  return paint;
}

function walks(lanes, runs, neighbourhood, reference) {
  const paint = new Paint(reference);
  for (const run of runs) {
    const [near, far] = PAVEMENT.map((out) => lineAt(run, () => BAY.depth + out));
    paint.strip(near, far, COLOURS.walk);
  }
  for (const corners of neighbourhood?.driveways ?? []) paint.area(corners, COLOURS.drive);
  for (const { points, width } of lanes.filter(({ kind }) => kind === "foot")) paint.line(points, width, COLOURS.walk);
  return paint;
}

function asphalt(lanes, outlines, runs, reference) {
  const paint = new Paint(reference);
  for (const run of runs) paint.strip(lineAt(run, () => -0.1), lineAt(run, (d) => bayDepth(run, d)), COLOURS.asphalt);
  for (const { points, width } of lanes) paint.line(points, width + 0.1, COLOURS.asphalt);
  for (const outline of outlines) paint.area(outline, COLOURS.asphalt);
  return paint;
}

function marks(scene, lanes, lines, reference) {
  const paint = new Paint(reference);
  // Each direction paints its half of the double line.
  for (const line of lines.centres) paint.line(beside(straightened(line), 0.12), MARK, COLOURS.yellow);
  for (const line of lines.dividers) for (const dash of dashes(straightened(line), 3, 9)) paint.line(dash, MARK, COLOURS.white);
  for (const lane of lanes.filter(({ kind }) => kind === "crossing")) {
    for (const bar of dashes(lane.points, 0.5, 0.5)) paint.line(bar, lane.width * 0.92, COLOURS.white);
  }
  for (const { x, y, heading, width } of scene.network?.stop_lines ?? []) {
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    paint.line([[x - 0.5 * c, y - 0.5 * s], [x - 0.1 * c, y - 0.1 * s]], (width ?? 3.2) - 0.3, COLOURS.white);
  }
  return paint;
}

/** Kerbs of stone along lines that have the road to their left. */
function kerbs(lines, reference) {
  const tiles = new Map();
  for (const line of lines) {
    const points = straightened(line);
    const normals = leftNormals(points);
    const ring = points.map(([x, y], i) => {
      const [nx, ny] = normals[i];
      const corners = [[x, y, 0], [x, y, KERB.height], [x - KERB.width * nx, y - KERB.width * ny, KERB.height]];
      return corners.map((corner) => reference.place(...corner));
    });
    for (let i = 0; i + 1 < ring.length; i++) {
      const shape = tileAt(tiles, tileOf(ring[i][0]), () => new Shape());
      for (let side = 0; side < 2; side++) {
        shape.face([ring[i][side], ring[i][side + 1], ring[i + 1][side + 1], ring[i + 1][side]], COLOURS.kerb);
      }
    }
  }
  const stone = bodyMaterial();
  return [...tiles.values()].map((shape) => {
    const mesh = new Mesh(shape.geometry(), stone);
    mesh.userData.kind = "kerb";
    return mesh;
  });
}
