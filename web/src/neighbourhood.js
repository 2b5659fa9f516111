// Houses, driveways, poles and parked cars along residential roads, always the same for the same street. They are decoration:
// no map has them and no sensor sees them, so nothing of it stands where somebody of the drive is. Where the map has
// buildings, no house is made up.

import { CylinderGeometry, Group, Mesh, SphereGeometry } from "three";
import { merged } from "./instances.js";
import { bodyMaterial, hashed } from "./shading.js";
import { Shape, moved } from "./shapes.js";
import { BAY, PAVEMENT, bayDepth, placeAt } from "./verge.js";

const [PITCH, SETBACK] = [19, 7.5]; //: of houses along the street, and from the pavement to their fronts [m]
const POLES = 38; //: distance of poles along a street [m]
const SLOT = 6.4; //: of a parked car along the street [m]
const [PARKED_SHARE, DRIVEWAY_CARS] = [0.42, 0.4];
const CLEAR = 9; //: from a parked car to whoever is beside the road in the drive, at least [m]
const FREE_OF_BUILDINGS = 45; //: around a building of the map no house is made up [m]
const TILE = 120; //: side of the squares that are drawn or left out as one [m]
const WALLS = ["#c9c5ba", "#a9b3b8", "#d8d2c2", "#8c9a92", "#b5a48c", "#9c5f4c", "#c7b79a", "#e3e0d8", "#7f8b98"];
const ROOFS = ["#4b4743", "#5a5048", "#3f4449", "#6a5a50", "#554a4e"];
const [TRIM, PANE, WOOD, CONCRETE, METAL] = ["#eceae4", "#27313a", "#6b5745", "#b3afa6", "#6d7276"];
const DOORS = ["#5a2f2a", "#2f3d4a", "#e6e2d8", "#3c4a3a"];
const [SIDING, SHINGLES] = [{ limb: 1 }, { limb: -1 }];

/** What stands beside the residential stretches of a scene: `group`, `driveways` [[x, y], …] of four corners, `parked` actors,
 * `lamps` {x, y, ux, uy} and `taken(x, y)`. */
export class Neighbourhood {
  constructor(scene, surface, runs, reference) {
    this.reference = reference;
    this.surface = surface;
    this.buildings = (scene.buildings ?? []).map(({ points }) => points[0]);
    this.keepClear = scene.keep_clear ?? [];
    this.bare = scene.nothing_parked ?? false; // where nobody knows yet who will be beside the road
    this.tiles = new Map();
    this.driveways = [];
    this.parked = [];
    this.lamps = [];
    this.footprints = new Map();
    runs.forEach((run, number) => this.#line(run, number));
    this.group = new Group();
    const [facade, plain, leaves] = [bodyMaterial({ facade: true, rough: 0.16, fine: 0.07 }), bodyMaterial(), bodyMaterial({ rough: 1.1, fine: 0.13 })];
    const materials = { building: facade, pole: plain, vegetation: leaves };
    for (const [key, bodies] of this.tiles) {
      const kind = key.split(" ")[0];
      const mesh = new Mesh(merged(bodies), materials[kind]);
      mesh.userData.kind = kind;
      this.group.add(mesh);
    }
  }

  /** Whether a house, a driveway or a pavement is at a place of the map. */
  taken(x, y) {
    return (this.footprints.get(cellOf(x, y)) ?? []).some(([px, py, r]) => Math.hypot(px - x, py - y) < r);
  }

  #take(x, y, r) {
    for (let i = Math.floor((x - r) / 10); i <= Math.floor((x + r) / 10); i++) {
      for (let j = Math.floor((y - r) / 10); j <= Math.floor((y + r) / 10); j++) {
        const key = `${i},${j}`;
        if (!this.footprints.has(key)) this.footprints.set(key, []);
        this.footprints.get(key).push([x, y, r]);
      }
    }
  }

  #stand(kind, geometry, { x, y, ux, uy }, size = [1, 1, 1]) {
    const [X, , Z] = this.reference.place(x, y);
    const key = `${kind} ${Math.floor(X / TILE)},${Math.floor(Z / TILE)}`;
    if (!this.tiles.has(key)) this.tiles.set(key, []);
    this.tiles.get(key).push([geometry, [X, Z, ux, uy, ...size, 0, 1, 1, 1, 0]]);
  }

  #line(run, number) {
    const long = run.at(-1).d;
    const seed = Math.round(run[0].x * 13) * 7919 + Math.round(run[0].y * 13) * 104729;
    const behind = BAY.depth + PAVEMENT[1];
    for (let d = 0; d <= long; d += 3) this.#take(...xy(placeAt(run, d, BAY.depth + 2)), 2.4);
    const gaps = [];
    for (let d = 12, k = 0; d < long - 8; d += PITCH, k++) {
      const gap = this.#lot(run, d + 3 * (hashed(seed + 31 * k) - 0.5), behind, seed + 101 * k);
      if (gap !== null) gaps.push(gap);
    }
    for (let d = 8 + 20 * hashed(seed), k = 0; d < long - 6; d += POLES, k++) this.#pole(run, d, number % 2 === 0, gaps);
    for (let d = BAY.from + BAY.taper + 3; d < long - BAY.from - BAY.taper - 3; d += SLOT) this.#park(run, d, gaps, seed + Math.round(d * 17));
  }

  /** A house with its garden and driveway; returns where along the kerb the driveway is, null without one. */
  #lot(run, d, behind, seed) {
    const tall = hashed(seed) < 0.45;
    const [wide, deep] = [8.5 + 3 * hashed(seed + 1), 7.5 + 2 * hashed(seed + 2)];
    const setback = SETBACK + 2.5 * hashed(seed + 3);
    const at = placeAt(run, d, behind + setback + deep / 2);
    if (!this.#free(at, Math.hypot(wide, deep) / 2 + 0.5)) return null;
    this.#take(at.x, at.y, Math.hypot(wide, deep) / 2 + 1.2);
    this.#stand("building", house(wide, deep, tall, seed), at);
    for (let k = 0; k < 4; k++) {
      if (hashed(seed + 40 + k) < 0.4) continue;
      const bush = placeAt(run, d + (k - 1.5) * 2.2 + 0.5, behind + setback - 0.8);
      this.#stand("vegetation", bushOf(), bush, Array(3).fill(0.6 + 0.5 * hashed(seed + 50 + k)));
    }
    const beside = d + wide / 2 + 2.2;
    if (beside > run.at(-1).d - 3) return null;
    const to = behind + setback + 3;
    const corner = (dd, out) => xy(placeAt(run, beside + dd, out));
    const kerb = bayDepth(run, beside);
    this.driveways.push([corner(-1.5, kerb - 0.05), corner(1.5, kerb - 0.05), corner(1.4, to), corner(-1.4, to)]);
    for (let out = behind; out < to; out += 2.5) this.#take(...corner(0, out), 2.2);
    if (hashed(seed + 4) < DRIVEWAY_CARS) {
      const place = placeAt(run, beside, behind + 3.1 + 1.5 * hashed(seed + 5));
      const turn = hashed(seed + 6) < 0.5 ? 1 : -1;
      this.#car({ ...place, ux: turn * place.uy, uy: -turn * place.ux }, seed);
    }
    return beside;
  }

  #free({ x, y }, radius) {
    if (this.taken(x, y) || this.surface.near(x, y, radius + 5)) return false;
    if ((this.footprints.get(cellOf(x, y)) ?? []).some(([px, py, r]) => Math.hypot(px - x, py - y) < r + radius - 1)) return false;
    return !this.buildings.some(([px, py]) => Math.hypot(px - x, py - y) < FREE_OF_BUILDINGS);
  }

  #pole(run, d, wires, gaps) {
    if (gaps.some((gap) => Math.abs(gap - d) < 2.4)) d += 4;
    const at = placeAt(run, d, bayDepth(run, d) + 0.6);
    if (wires) return this.#stand("pole", utilityPole(), at);
    this.#stand("pole", lampPost(), at);
    this.lamps.push({ x: at.x - 1.9 * at.uy, y: at.y + 1.9 * at.ux });
    return null;
  }

  #park(run, d, gaps, seed) {
    if (hashed(seed) > PARKED_SHARE || gaps.some((gap) => Math.abs(gap - d) < 4.6)) return;
    this.#car(placeAt(run, d, BAY.depth / 2 + 0.12 * (hashed(seed + 1) - 0.5)), seed);
  }

  #car({ x, y, ux, uy }, seed) {
    if (this.bare || this.keepClear.some(([px, py]) => Math.hypot(px - x, py - y) < CLEAR)) return;
    const heading = Math.atan2(uy, ux) + 0.03 * (hashed(seed + 7) - 0.5);
    const van = hashed(seed + 8) < 0.08;
    const size = van ? { kind: "van", length: 5.4, width: 1.95, height: 2.25 } : { kind: "car", length: 4.3 + 0.5 * hashed(seed + 9), width: 1.8, height: 1.45 + 0.2 * hashed(seed + 10) };
    this.parked.push({ id: `decoration.${this.parked.length}`, x, y, heading, ...size });
  }
}

const xy = ({ x, y }) => [x, y];
const cellOf = (x, y) => `${Math.floor(x / 10)},${Math.floor(y / 10)}`;

const made = new Map();
function once(key, make) {
  if (!made.has(key)) made.set(key, make());
  return made.get(key);
}

/** A house about its middle: +X along the street, its front towards the street on -Z. */
function house(wide, deep, tall, seed) {
  const shape = new Shape();
  const pick = (list, k) => list[Math.floor(hashed(seed + k) * list.length)];
  const [wall, roof, door] = [pick(WALLS, 11), pick(ROOFS, 12), pick(DOORS, 13)];
  const [high, rise] = [tall ? 5.4 : 2.9, 1.9 + 0.9 * hashed(seed + 14)];
  const [w, f] = [wide / 2, deep / 2];
  const gabled = hashed(seed + 15) < 0.5;
  shape.block([0, 0.2, 0], [wide + 0.1, 0.4, deep + 0.1], "#8f8b84");
  walls(shape, w, f, high, wall);
  if (gabled) gableRoof(shape, w, f, high, rise, roof, wall);
  else eavesRoof(shape, w, f, high, rise, roof, wall);
  for (let storey = 0; storey < (tall ? 2 : 1); storey++) fronts(shape, w, f, 0.4 + storey * 2.5, storey === 0 ? door : null, seed + storey);
  porch(shape, w, f, seed);
  shape.block([0.6 * w, high + rise * 0.75, 0.3 * f], [0.7, rise * 1.3, 0.7], "#7a4a3e", SIDING);
  return shape.geometry();
}

function walls(shape, w, f, high, wall) {
  const corners = [[-w, -f], [w, -f], [w, f], [-w, f]];
  corners.forEach(([x, z], i) => {
    const [u, v] = corners[(i + 1) % 4];
    shape.face([[u, 0, v], [x, 0, z], [x, high, z], [u, high, v]], wall, SIDING);
  });
}

/** A roof whose gable faces the street. */
function gableRoof(shape, w, f, high, rise, roof, wall) {
  const o = 0.45;
  for (const side of [-1, 1]) {
    slope(shape, turnedIf(side < 0, [[side * (w + o), high - 0.1, f + o], [side * (w + o), high - 0.1, -f - o], [0, high + rise, -f - o], [0, high + rise, f + o]]), roof);
    const z = side * f;
    shape.face(turnedIf(side < 0, [[-w, high, z], [w, high, z], [0, high + rise, z]]), wall, SIDING);
    const edge = z + side * o;
    for (const half of [-1, 1]) {
      const board = [[half * (w + o), high - 0.3, edge], [half * (w + o), high - 0.08, edge], [0, high + rise + 0.02, edge], [0, high + rise - 0.2, edge]];
      shape.face(board, TRIM).face([...board].reverse(), TRIM);
    }
  }
  window(shape, [0, high + rise * 0.3, -f], 0.8, 0.9);
}

/** A roof whose eaves run along the street. */
function eavesRoof(shape, w, f, high, rise, roof, wall) {
  const o = 0.5;
  for (const side of [-1, 1]) {
    slope(shape, turnedIf(side < 0, [[-w - o, high - 0.1, side * (f + o)], [w + o, high - 0.1, side * (f + o)], [w + o, high + rise, 0], [-w - o, high + rise, 0]]), roof);
    shape.face(turnedIf(side < 0, [[side * w, high, f], [side * w, high, -f], [side * w, high + rise, 0]]), wall, SIDING);
    shape.block([0, high - 0.14, side * (f + o)], [2 * w + 2 * o, 0.2, 0.08], TRIM);
  }
}

/** A slope of a roof, with boards beneath. */
function slope(shape, corners, roof) {
  shape.face(corners, roof, SHINGLES).face([...corners].reverse(), TRIM);
}

const turnedIf = (turned, corners) => (turned ? [...corners].reverse() : corners);

/** A window in the wall that faces -Z, its middle at a place. */
function window(shape, [x, y, z], wide, high) {
  shape.block([x, y, z - 0.03], [wide + 0.24, high + 0.24, 0.06], TRIM);
  const [l, h, at] = [wide / 2, high / 2, z - 0.07];
  shape.face([[x + l, y - h, at], [x - l, y - h, at], [x - l, y + h, at], [x + l, y + h, at]], PANE, { gloss: 0.7 });
  shape.block([x, y, at], [0.05, high, 0.03], TRIM);
  shape.block([x, y, at], [wide, 0.05, 0.03], TRIM);
}

/** Windows of the storey whose floor is at a height, on front and sides; on the ground floor a door. */
function fronts(shape, w, f, floor, door, seed) {
  const count = Math.max(2, Math.round((2 * w) / 2.9));
  for (let k = 0; k < count; k++) {
    const x = -w + ((k + 0.5) / count) * 2 * w;
    if (door && k === Math.floor(count / 2)) {
      shape.block([x, floor + 1.05, -f - 0.04], [1.2, 2.2, 0.08], TRIM);
      shape.block([x, floor + 1.02, -f - 0.08], [0.92, 2.0, 0.06], door);
    } else window(shape, [x, floor + 1.35, -f], hashed(seed + 60 + k) < 0.3 ? 1.7 : 1.0, 1.25);
  }
  for (const side of [-1, 1]) for (const z of [-f / 2, f / 2]) {
    shape.block([side * (w + 0.03), floor + 1.35, z], [0.06, 1.4, 1.15], TRIM);
    shape.block([side * (w + 0.05), floor + 1.35, z], [0.06, 1.2, 0.95], PANE, { gloss: 0.7 });
  }
}

/** A porch with posts, or steps alone. */
function porch(shape, w, f, seed) {
  shape.block([0, 0.2, -f - 0.9], [3.2, 0.4, 1.8], CONCRETE);
  shape.block([0, 0.1, -f - 2.0], [1.6, 0.2, 0.5], CONCRETE);
  if (hashed(seed + 16) < 0.4) return;
  for (const side of [-1, 1]) shape.block([side * 1.45, 1.5, -f - 1.65], [0.14, 2.3, 0.14], TRIM);
  shape.block([0, 2.75, -f - 0.95], [3.5, 0.18, 2.0], TRIM);
  shape.face([[1.85, 2.84, -f - 2.1], [-1.85, 2.84, -f - 2.1], [-1.85, 3.4, -f], [1.85, 3.4, -f]], "#4b4743", SHINGLES);
}

const bushOf = () =>
  once("bush", () => {
    const shape = new Shape();
    for (const [x, y, z, r] of [[0, 0.5, 0, 0.62], [0.4, 0.4, 0.15, 0.48], [-0.4, 0.42, -0.1, 0.5]]) {
      shape.part(new SphereGeometry(r, 8, 6), moved([x, y, z]), x ? "#42592f" : "#4d6538");
    }
    return shape.geometry();
  });

/** A wooden pole with a crossarm across the street, its insulators and a transformer. */
const utilityPole = () =>
  once("utility", () => {
    const shape = new Shape();
    shape.part(new CylinderGeometry(0.11, 0.16, 10.2, 8), moved([0, 5.1, 0]), WOOD);
    shape.block([0, 9.4, 0], [0.12, 0.14, 2.4], WOOD);
    for (const z of [-1.1, -0.6, 0.6, 1.1]) shape.part(new CylinderGeometry(0.04, 0.05, 0.2, 6), moved([0, 9.57, z]), "#7d7f80");
    shape.part(new CylinderGeometry(0.22, 0.22, 0.9, 8), moved([0.1, 7.9, 0.35]), METAL);
    return shape.geometry();
  });

/** A lamp on an arm over the street, which is on -Z. */
const lampPost = () =>
  once("lamp", () => {
    const shape = new Shape();
    shape.part(new CylinderGeometry(0.07, 0.11, 7, 8), moved([0, 3.5, 0]), METAL);
    shape.part(new CylinderGeometry(0.04, 0.05, 1.8, 6), moved([0, 7.0, -0.85], [Math.PI / 2, 0, 0]), METAL);
    shape.block([0, 7.02, -1.9], [0.26, 0.14, 0.7], METAL);
    shape.block([0, 6.93, -1.9], [0.2, 0.05, 0.55], "#fff1d0", { glow: 0.6 });
    return shape.geometry();
  });
