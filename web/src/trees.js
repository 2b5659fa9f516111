// Trees in rows behind the kerbs, always the same for the same street. They are decoration: no map has them, no sensor sees
// them, and they stand clear of every road.

import { Color, ConeGeometry, CylinderGeometry, Group, IcosahedronGeometry, Mesh, Sphere, SphereGeometry, Vector3 } from "three";
import { Lot, merged, shadowRow, shadows } from "./instances.js";
import { along, inside } from "./road_surface.js";
import { bodyMaterial, hashed } from "./shading.js";
import { Shape, moved } from "./shapes.js";

const SPACING = 13; //: along a road [m]
const CLEAR = 4.5; //: from a tree's middle to the nearest road, at least [m]
const GROVE = 90; //: side of the squares of which the trees are drawn or left out as one [m]
//: trees are fine and have shadows within the first distance; groves are left out beyond the second [m]
const [FINE_WITHIN, SEEN_WITHIN] = [48, 460];
const BARK = "#54463a";
const LEAVES = ["#4f6b3a", "#5c7842", "#466238", "#6b8148"];
const LEAFY = { painted: 1 };

export class Trees {
  /** With `detail` leaves have grain; `taken` says of a place {x, y} of the map whether something else stands there. */
  constructor(scene, surface, reference, { detail = false, taken = () => false } = {}) {
    const leaves = detail ? { rough: 1.1, fine: 0.13 } : {};
    this.groves = new Map();
    for (const { x, y, seed } of planted(scene, surface, taken)) this.#plant(reference.place(x, y), seed);
    const plain = [roundTree(false), firTree(false)];
    const lot = (geometry) => new Lot(geometry, bodyMaterial({ instanced: true, ...leaves }), 0, "vegetation");
    this.lots = { fine: [roundTree(true), firTree(true)].map(lot), plain: plain.map(lot) };
    this.shadows = shadows();
    this.group = new Group();
    this.group.add(this.shadows.mesh, ...this.#allLots().map(({ mesh }) => mesh));
    this.#farGroves(plain, leaves);
  }

  #allLots() {
    return [...this.lots.fine, ...this.lots.plain];
  }

  /** Make one body of each grove, as it is seen from far. */
  #farGroves(plain, leaves) {
    const material = bodyMaterial(leaves);
    for (const grove of this.groves.values()) {
      grove.far = new Mesh(merged(grove.trees.map(({ kind, row }) => [plain[kind], row])), material);
      grove.far.userData.kind = "vegetation";
      this.group.add(grove.far);
    }
  }

  #plant([X, , Z], seed) {
    const [i, j] = [Math.floor(X / GROVE), Math.floor(Z / GROVE)];
    const key = `${i},${j}`;
    if (!this.groves.has(key)) {
      const middle = new Vector3((i + 0.5) * GROVE, 4, (j + 0.5) * GROVE);
      this.groves.set(key, { sphere: new Sphere(middle, 0.75 * GROVE + 6), trees: [] });
    }
    const size = 0.75 + 0.6 * hashed(seed + 2);
    const { r, g, b } = new Color(LEAVES[Math.floor(hashed(seed + 3) * LEAVES.length)]);
    const turned = 6.3 * hashed(seed + 6);
    const row = [X, Z, Math.cos(turned), Math.sin(turned), size, size, size, 0, r, g, b, 0];
    this.groves.get(key).trees.push({ row, kind: hashed(seed + 4) < 0.2 ? 1 : 0 });
  }

  /** Have the trees stand that a camera at `eye` sees; `view` is its frustum, null for all sides. */
  show(eye, view) {
    for (const lot of this.#allLots()) lot.clear();
    this.shadows.clear();
    for (const { sphere, trees, far } of this.groves.values()) {
      const distance = sphere.center.distanceTo(eye) - sphere.radius;
      const seen = distance < SEEN_WITHIN && view?.intersectsSphere(sphere) !== false;
      far.visible = seen && distance >= FINE_WITHIN;
      if (!seen || distance >= FINE_WITHIN) continue;
      for (const { row, kind } of trees) {
        const near = Math.hypot(row[0] - eye.x, row[1] - eye.z) < FINE_WITHIN;
        this.lots[near ? "fine" : "plain"][kind].add(row);
        // Away from the sun.
        if (near) this.shadows.add(shadowRow(row[0] + 0.8, row[1] - 0.9, 1, 0, 5, 5, 2.5));
      }
    }
    for (const lot of [...this.#allLots(), this.shadows]) lot.commit();
  }
}

/** Places for trees along the lanes [map m], clear of roads and buildings, with a number for each. */
function* planted(scene, surface, taken) {
  const cells = new Set();
  const built = scene.buildings ?? [];
  for (const lane of surface.lanes) {
    if (lane.kind !== "road") continue;
    let walked = 0;
    for (const { x, y, ux, uy } of along(lane.points, 1)) {
      if (walked++ % SPACING !== 0) continue;
      const seed = Math.round(x) * 7919 + Math.round(y) * 104729;
      const out = lane.width / 2 + CLEAR + 1 + 5 * hashed(seed);
      const [tx, ty] = [x + uy * out + 3 * ux * hashed(seed + 5), y - ux * out + 3 * uy * hashed(seed + 5)];
      const cell = `${Math.round(tx / 7)},${Math.round(ty / 7)}`;
      if (cells.has(cell) || hashed(seed + 1) < 0.25 || surface.near(tx, ty, CLEAR)) continue;
      cells.add(cell);
      if (!taken(tx, ty) && !built.some(({ points }) => inside(points, tx, ty))) yield { x: tx, y: ty, seed };
    }
  }
}

/** A tree with a round crown, about 6 m high. */
function roundTree(fine) {
  const shape = new Shape();
  shape.part(new CylinderGeometry(0.14, 0.2, 3, fine ? 6 : 3, 1, true), moved([0, 1.5, 0]), BARK);
  if (!fine) return shape.part(new SphereGeometry(2.1, 5, 4), moved([0, 4.4, 0]), "#ffffff", LEAFY).geometry();
  for (const [x, y, z, r] of [[0, 4.6, 0, 1.9], [0.9, 3.9, 0.5, 1.35], [-0.8, 4.1, -0.6, 1.4], [0.1, 4.2, -1, 1.2]]) {
    shape.part(new IcosahedronGeometry(r, 1), moved([x, y, z]), "#ffffff", LEAFY);
  }
  return shape.geometry();
}

/** A fir, about 8 m high. */
function firTree(fine) {
  const shape = new Shape();
  shape.part(new CylinderGeometry(0.14, 0.2, 2, fine ? 6 : 3, 1, true), moved([0, 1, 0]), BARK);
  const tiers = fine ? [[1.8, 3.2, 2.9], [1.45, 2.9, 4.6], [1.0, 2.6, 6.2]] : [[1.7, 6.2, 4.4]];
  for (const [radius, height, y] of tiers) {
    shape.part(new ConeGeometry(radius, height, fine ? 9 : 4, 1, true), moved([0, y, 0]), "#ffffff", LEAFY);
  }
  return shape.geometry();
}
