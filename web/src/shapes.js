// Puts bodies together from faces with a colour: forward is +X, up is +Y, right is +Z, metres.

import { BufferAttribute, BufferGeometry, Color, Matrix4, Vector3 } from "three";

const PLAIN = { gloss: 0, glow: 0, painted: 0, limb: 0, joint: 0 };

/** Collects triangles; `geometry` makes one geometry of them, so that a body is one draw. */
export class Shape {
  constructor() {
    this.positions = [];
    this.normals = [];
    this.tints = [];
    this.surfaces = [];
  }

  /** Add a flat face with three or more corners, counter-clockwise seen from outside. */
  face(corners, colour, look = {}) {
    const [a, b, c] = corners.map((corner) => new Vector3(...corner));
    const normal = b.clone().sub(a).cross(c.clone().sub(a)).normalize();
    if (!Number.isFinite(normal.x) || normal.lengthSq() < 0.5) return this;
    for (let i = 1; i + 1 < corners.length; i++) {
      for (const corner of [corners[0], corners[i], corners[i + 1]]) this.#vertex(corner, normal.toArray(), colour, look);
    }
    return this;
  }

  /** Add a face and its mirror image on the car's other side. */
  pair(corners, colour, look = {}) {
    this.face(corners, colour, look);
    return this.face([...corners].reverse().map(([x, y, z]) => [x, y, -z]), colour, look);
  }

  /** Add a block by its middle and its size along, up and across; `top` shrinks the upper face by a factor. */
  block([x, y, z], [along, up, across], colour, look = {}, top = 1) {
    const [l, h, w] = [along / 2, up / 2, across / 2];
    const corner = (i, j, k) => [x + i * l * (j > 0 ? top : 1), y + j * h, z + k * w * (j > 0 ? top : 1)];
    const quad = (...signs) => this.face(signs.map((s) => corner(...s)), colour, look);
    quad([-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]);
    quad([-1, -1, -1], [1, -1, -1], [1, -1, 1], [-1, -1, 1]);
    quad([1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]);
    quad([-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]);
    quad([-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]);
    return quad([-1, -1, -1], [-1, 1, -1], [1, 1, -1], [1, -1, -1]);
  }

  /** Add a geometry of three.js, moved by a matrix, in one colour, with the normals that it has. */
  part(geometry, matrix, colour, look = {}) {
    const plain = geometry.index ? geometry.toNonIndexed() : geometry;
    const moved = plain.clone().applyMatrix4(matrix);
    const [at, normal] = [moved.getAttribute("position"), moved.getAttribute("normal")];
    for (let i = 0; i < at.count; i++) {
      this.#vertex([at.getX(i), at.getY(i), at.getZ(i)], [normal.getX(i), normal.getY(i), normal.getZ(i)], colour, look);
    }
    return this;
  }

  #vertex(position, normal, colour, look) {
    const { gloss, glow, painted, limb, joint } = { ...PLAIN, ...look };
    const { r, g, b } = colourOf(colour);
    this.positions.push(...position);
    this.normals.push(...normal);
    this.tints.push(r * 255, g * 255, b * 255, painted * 255);
    this.surfaces.push(gloss * 255, glow * 255, (limb * 0.5 + 0.5) * 254, (joint / 2) * 255);
  }

  /**
   * Return the triangles as one geometry; faces of the same gloss that meet at less than `crease` [rad] are shaded as one: a
   * pane does not bend into the paint around it. A corner that several triangles have alike is held once.
   */
  geometry(crease = 0) {
    const normals = crease > 0 ? softened(this.positions, this.normals, this.surfaces, crease) : this.normals;
    const [index, kept] = [[], []];
    const there = new Map();
    for (let i = 0; i < this.positions.length / 3; i++) {
      const key = this.#key(i, normals);
      if (!there.has(key)) {
        there.set(key, kept.length);
        kept.push(i);
      }
      index.push(there.get(key));
    }
    const column = (values, size) => kept.flatMap((i) => values.slice(size * i, size * i + size));
    const made = new BufferGeometry();
    made.setIndex(index);
    made.setAttribute("position", new BufferAttribute(new Float32Array(column(this.positions, 3)), 3));
    made.setAttribute("normal", new BufferAttribute(new Float32Array(column(normals, 3)), 3));
    made.setAttribute("tint", new BufferAttribute(new Uint8Array(column(this.tints, 4).map(Math.round)), 4, true));
    made.setAttribute("surface", new BufferAttribute(new Uint8Array(column(this.surfaces, 4).map(Math.round)), 4, true));
    return made;
  }

  #key(i, normals) {
    const part = (values, size, scale) => {
      let text = "";
      for (let k = size * i; k < size * i + size; k++) text += `${Math.round(values[k] * scale)},`;
      return text;
    };
    return part(this.positions, 3, 1000) + part(normals, 3, 100) + part(this.tints, 4, 1) + part(this.surfaces, 4, 1);
  }
}

const known = new Map();
function colourOf(text) {
  if (!known.has(text)) known.set(text, new Color(text));
  return known.get(text);
}

/** Return the mean, at every vertex, of the normals of all faces of its gloss there that differ from its own by less than `crease`. */
function softened(positions, normals, surfaces, crease) {
  const there = new Map();
  const key = (i) => [...[0, 1, 2].map((k) => Math.round(positions[3 * i + k] * 1000)), Math.round(surfaces[4 * i])].join();
  const count = positions.length / 3;
  for (let i = 0; i < count; i++) {
    if (!there.has(key(i))) there.set(key(i), []);
    there.get(key(i)).push(i);
  }
  const least = Math.cos(crease);
  const soft = new Array(normals.length);
  const normal = (i) => new Vector3(normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
  for (let i = 0; i < count; i++) {
    const own = normal(i);
    const sum = new Vector3();
    for (const j of there.get(key(i))) if (own.dot(normal(j)) >= least) sum.add(normal(j));
    sum.normalize().toArray(soft, 3 * i);
  }
  return soft;
}

/** A matrix that moves to a place and turns about the axes X, Y, Z in this order [rad]. */
export function moved([x, y, z], [aboutX, aboutY, aboutZ] = [0, 0, 0]) {
  const turn = new Matrix4().makeRotationZ(aboutZ);
  turn.multiply(new Matrix4().makeRotationY(aboutY)).multiply(new Matrix4().makeRotationX(aboutX));
  return new Matrix4().makeTranslation(x, y, z).multiply(turn);
}
