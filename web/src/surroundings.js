// What stands beside the street: signals with their lamps, buildings as blocks, and the sky.

import { BackSide, BufferAttribute, BufferGeometry, CylinderGeometry, Group, Mesh, ShaderMaterial, SphereGeometry } from "three";
import { skyColours } from "./light.js";
import { bodyMaterial, hashed } from "./shading.js";
import { Shape, moved } from "./shapes.js";
import { turning } from "./road_surface.js";

const LAMPS = { r: ["#ff3020", 0], y: ["#ffc21a", 1], g: ["#25e06a", 2], u: ["#ffc21a", 1], o: ["#ffc21a", 1] };
const OFF = ["#3a1512", "#3a2d10", "#0f2f1b"];

/** Signal heads on masts, one for each controlled link, and the way to set their lamps. */
export class Signals {
  constructor(scene, reference) {
    this.group = new Group();
    this.heads = new Map();
    this.material = bodyMaterial();
    this.built = { masts: new Map(), lamps: new Map() };
    for (const signal of scene.network?.signals ?? []) this.#add(signal, reference);
  }

  #add({ id, link, x, y, heading, reach }, reference) {
    const head = new Group();
    head.position.set(...reference.place(x, y));
    // A head looks back at the traffic that comes to it.
    head.rotation.y = heading + Math.PI;
    const lamps = new Mesh(this.#lamps("off"), this.material);
    const mast = new Mesh(this.#mast(reach), this.material);
    mast.userData.kind = lamps.userData.kind = "signal";
    head.add(mast, lamps);
    this.group.add(head);
    this.heads.set(`${id} ${link}`, { id, link, lamps });
  }

  /** Light the lamps: SUMO's letters of each signal's links by its name; null where nobody says them. */
  show(states) {
    for (const { id, link, lamps } of this.heads.values()) lamps.geometry = this.#lamps(states?.[id]?.[link] ?? "off");
  }

  #mast(reach) {
    const known = this.built.masts;
    if (!known.has(reach)) known.set(reach, mast(reach));
    return known.get(reach);
  }

  #lamps(letter) {
    const known = this.built.lamps;
    if (!known.has(letter)) known.set(letter, lampsOf(letter));
    return known.get(letter);
  }

  dispose() {
    for (const made of [...this.built.masts.values(), ...this.built.lamps.values()]) made.dispose();
    this.material.dispose();
  }
}

const HEAD = 5.1; //: of the lowest lamp over the road [m]

/** A head on an arm with its mast `reach` to the right of it [m]; forward +X is towards the traffic. */
function mast(reach) {
  const shape = new Shape();
  // Seen by who comes, the mast is on the right: that is towards -Z of the head's own frame.
  shape.part(new CylinderGeometry(0.08, 0.11, 6.1, 8), moved([0, 3.05, -reach]), "#5c6166", { gloss: 0.2 });
  shape.part(new CylinderGeometry(0.05, 0.07, reach + 0.3, 6), moved([-0.12, 6.0, -reach / 2], [Math.PI / 2, 0, 0]), "#5c6166", { gloss: 0.2 });
  shape.block([0, HEAD + 0.35, 0], [0.2, 1.1, 0.36], "#1c1e20");
  shape.block([-0.08, HEAD + 0.35, 0], [0.03, 1.35, 0.6], "#24272a");
  return shape.geometry(0.5);
}

function lampsOf(letter) {
  const shape = new Shape();
  const [colour, lit] = LAMPS[letter.toLowerCase()] ?? ["", -1];
  for (const place of [0, 1, 2]) {
    const on = place === lit;
    const lens = new CylinderGeometry(0.125, 0.125, 0.05, 14);
    shape.part(lens, moved([0.11, HEAD + 0.7 - 0.35 * place, 0], [0, 0, Math.PI / 2]), on ? colour : OFF[place], { glow: on ? 1 : 0.1 });
  }
  return shape.geometry();
}

const WALLS = ["#b9a58f", "#a7674f", "#c7c1b4", "#8f8a80", "#9d7a62", "#d0c9bb"];
const STOREY = 3.1; //: [m]

/** Buildings of a scene as blocks with rows of windows. */
export function buildings(scene, reference) {
  const group = new Group();
  const material = bodyMaterial();
  (scene.buildings ?? []).forEach(({ points, height }, index) => {
    if (points.length < 3) return;
    const outline = turning(points) > 0 ? points : [...points].reverse();
    const mesh = new Mesh(block(outline, height ?? 2 * STOREY, WALLS[Math.floor(hashed(index) * WALLS.length)], reference), material);
    mesh.userData.kind = "building";
    group.add(mesh);
  });
  return group;
}

/** Walls around an outline that runs counter-clockwise, and a flat roof. */
function block(outline, height, colour, reference) {
  const shape = new Shape();
  outline.forEach((from, i) => {
    const to = outline[(i + 1) % outline.length];
    const wall = [[...from, 0], [...to, 0], [...to, height], [...from, height]];
    shape.face(wall.map((corner) => reference.place(...corner)), colour);
    windows(shape, from, to, height, reference);
  });
  roof(shape, outline, height, reference);
  return shape.geometry();
}

function windows(shape, [ax, ay], [bx, by], height, reference) {
  const long = Math.hypot(bx - ax, by - ay);
  const columns = Math.floor((long - 0.8) / 2.6);
  if (columns < 1) return;
  const [ux, uy] = [(bx - ax) / long, (by - ay) / long];
  const corner = (d, h) => reference.place(ax + ux * d + 0.03 * uy, ay + uy * d - 0.03 * ux, h);
  for (let floor = 0; floor * STOREY + 2.6 < height; floor++) {
    for (let k = 0; k < columns; k++) {
      const [middle, low] = [((k + 0.5) / columns) * long, floor * STOREY + 1.0];
      const pane = [corner(middle - 0.55, low), corner(middle + 0.55, low), corner(middle + 0.55, low + 1.4), corner(middle - 0.55, low + 1.4)];
      shape.face(pane, "#2b3640", { gloss: 0.8 });
    }
  }
}

function roof(shape, outline, height, reference) {
  const middle = [0, 1].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length);
  outline.forEach((from, i) => {
    const to = outline[(i + 1) % outline.length];
    const turns = (from[0] - middle[0]) * (to[1] - middle[1]) > (from[1] - middle[1]) * (to[0] - middle[0]);
    if (turns) shape.face([[...from, height], [...to, height], [...middle, height]].map((c) => reference.place(...c)), "#77736c");
  });
}

/** The sky with a haze over a far tree line; follows the camera. */
export function sky() {
  const dome = new SphereGeometry(1000, 32, 24);
  const at = dome.getAttribute("position");
  const tints = [];
  const { zenith, horizon, haze, far } = skyColours();
  for (let i = 0; i < at.count; i++) {
    const up = at.getY(i) / 1000;
    const colour = up > 0 ? horizon.clone().lerp(zenith, Math.min(1, Math.pow(up, 0.6) * 1.15)) : haze;
    tints.push(colour.r, colour.g, colour.b);
  }
  dome.setAttribute("tint", new BufferAttribute(new Float32Array(tints), 3));
  const group = new Group();
  group.add(new Mesh(dome, skyMaterial(BackSide)), new Mesh(treeLine(far, haze), skyMaterial(BackSide)));
  group.children.forEach((mesh, i) => {
    mesh.renderOrder = -10 + i;
    mesh.frustumCulled = false;
  });
  return group;
}

/** A ring of far trees, paler towards the ground. */
function treeLine(far, haze) {
  const made = new BufferGeometry();
  const [positions, tints] = [[], []];
  const count = 240;
  const height = (i) => 6 + 7 * hashed((i % count) + 9000) + 9 * hashed((Math.floor(i / 6) % (count / 6)) + 500);
  for (let i = 0; i < count; i++) {
    const corner = (k, y) => [900 * Math.cos((2 * Math.PI * k) / count), y, 900 * Math.sin((2 * Math.PI * k) / count)];
    const quad = [corner(i, -14), corner(i + 1, -14), corner(i + 1, height(i + 1)), corner(i, -14), corner(i + 1, height(i + 1)), corner(i, height(i))];
    for (const point of quad) {
      positions.push(...point);
      tints.push(...(point[1] > 0 ? far : haze).toArray());
    }
  }
  made.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  made.setAttribute("tint", new BufferAttribute(new Float32Array(tints), 3));
  return made;
}

function skyMaterial(side) {
  return new ShaderMaterial({
    side,
    depthWrite: false,
    vertexShader: /* glsl */ `
      attribute vec3 tint;
      varying vec3 shade;
      void main() {
        shade = tint;
        gl_Position = projectionMatrix * mat4(mat3(viewMatrix)) * vec4(position, 1.0);
      }`,
    fragmentShader: /* glsl */ `
      varying vec3 shade;
      void main() { gl_FragColor = vec4(shade, 1.0); }`,
  });
}
