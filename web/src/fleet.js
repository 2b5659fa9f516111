// All actors: each kind one geometry, drawn once for all of it, finer near the camera. Nothing is kept from picture to
// picture, so that the same frame always gives the same picture.

import { Color, CustomBlending, DynamicDrawUsage, Frustum, Group, InstancedBufferAttribute, InstancedBufferGeometry, Matrix4, Mesh, PlaneGeometry, ShaderMaterial, Sphere, Vector3 } from "three";
import { cyclist, motorcyclist, pedestrian } from "./people.js";
import { LONGEST_PREDICTION } from "./frame_of_reference.js";
import { bodyMaterial, hashedText } from "./shading.js";
import { bus, saloon, truck, van } from "./vehicles.js";

//: size of each model as it is made, along, up, across [m]; how far a limb swings [rad]; metres of a whole gait
const KINDS = {
  passenger: { make: saloon, size: [4.87, 1.48, 1.86] },
  van: { make: van, size: [5.5, 2.4, 2.0] },
  truck: { make: truck, size: [8.5, 3.4, 2.5] },
  bus: { make: bus, size: [12, 3.1, 2.55] },
  motorcycle: { make: motorcyclist, size: [2.1, 1.5, 0.8] },
  bicycle: { make: cyclist, size: [1.75, 1.75, 0.65] },
  pedestrian: { make: pedestrian, size: [0.5, 1.75, 0.56], swing: 0.5, gait: 1.5 },
  child: { make: pedestrian, size: [0.5, 1.75, 0.56], swing: 0.6, gait: 1.0 },
};
const SAME = { car: "passenger", other: "passenger", taxi: "passenger", delivery: "van", coach: "bus", trailer: "truck", moped: "motorcycle" };
//: how high a body stands whose height nobody says [m]; people and what they ride keep theirs
const HEIGHTS = { passenger: 1.5, van: 2.3, truck: 3.4, bus: 3.1, motorcycle: 1.5, bicycle: 1.75, pedestrian: 1.75, child: 1.2 };
const PAINTS = ["#c9ccce", "#8e9499", "#43494f", "#26292d", "#7b2a2c", "#e9e9e6", "#5d6a5f", "#a89a80", "#35505f", "#b9b3a6"];
const CLOTHES = ["#8a3b3b", "#2f6f73", "#b98a34", "#50608a", "#6d5a7d", "#c4bcae", "#3d5c45", "#a35a2e"];
const FINE_WITHIN = 45; //: [m]
const SEEN_WITHIN = 700; //: [m]

/** What kind of body an actor has, of those that can be drawn. */
export const kindOf = (actor) => (KINDS[actor?.kind] ? actor.kind : SAME[actor?.kind] ?? "passenger");

/** The colour of an actor's paint or clothes, by its name. */
export function paintOf(id, kind) {
  const worn = ["pedestrian", "child", "bicycle", "motorcycle"].includes(kind) ? CLOTHES : PAINTS;
  return worn[Math.floor(hashedText(id) * worn.length)];
}

export class Fleet {
  constructor(scene, reference) {
    this.actors = scene.actors ?? {};
    this.reference = reference;
    this.group = new Group();
    this.lots = new Map();
    this.shadows = new Lot(shadowQuad(), shadowMaterial(), 5);
    this.group.add(this.shadows.mesh);
  }

  #lot(kind, fine) {
    const key = `${kind}${fine ? "" : " far"}`;
    if (!this.lots.has(key)) {
      const lot = new Lot(KINDS[kind].make(fine), bodyMaterial({ instanced: true }), 10);
      this.lots.set(key, lot);
      this.group.add(lot.mesh);
    }
    return this.lots.get(key);
  }

  /**
   * Have the actors of a frame stand where they are `ahead` seconds after it, as far as a camera sees them; with
   * `around` those on all sides, for a head that may turn.
   */
  show({ id, x, y, heading, speed }, ahead, camera, around) {
    const time = Math.min(Math.max(ahead, -LONGEST_PREDICTION), LONGEST_PREDICTION);
    for (const lot of this.lots.values()) lot.clear();
    this.shadows.clear();
    const view = around ? null : new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    const eye = new Vector3().setFromMatrixPosition(camera.matrixWorld);
    for (let i = 0; i < id.length; i++) {
      if (x[i] === null || y[i] === null || heading[i] === null) continue;
      const [c, s, v] = [Math.cos(heading[i]), Math.sin(heading[i]), speed[i] ?? 0];
      this.#stand(id[i], x[i] + c * v * time, y[i] + s * v * time, c, s, v, view, eye);
    }
    for (const lot of this.lots.values()) lot.commit();
    this.shadows.commit();
  }

  #stand(id, x, y, c, s, speed, view, eye) {
    const actor = this.actors[id];
    const kind = kindOf(actor);
    const { size, swing = 0, gait = 1 } = KINDS[kind];
    const long = actor?.length ?? size[0];
    const wide = actor?.width ?? size[2];
    const high = actor?.height ?? HEIGHTS[kind];
    const [X, , Z] = this.reference.place(x, y);
    const middle = new Vector3(X, high / 2, Z);
    const far = middle.distanceTo(eye);
    if (far > SEEN_WITHIN || view?.intersectsSphere(new Sphere(middle, 0.6 * Math.hypot(long, high, wide))) === false) return;
    const onFoot = kind === "pedestrian" || kind === "child";
    // A person is as deep and wide as people are: the box around one is a safety margin.
    const stretch = onFoot ? [high / size[1], high / size[1], high / size[1]] : [long / size[0], high / size[1], wide / size[2]];
    // The gait follows from the place, not from time: who stands still does not step.
    const phase = (((x * c + y * s) % gait) / gait) * 2 * Math.PI;
    const paint = new Color(paintOf(id, kind));
    const row = [X, Z, c, s, ...stretch, phase, paint.r, paint.g, paint.b, speed > 0.1 ? swing : 0];
    this.#lot(kind, far < FINE_WITHIN).add(row);
    const shade = onFoot ? [0.6, 1, 0.6] : [long + 0.5, 1, wide + 0.45];
    this.shadows.add([X, Z, c, s, ...shade, 0, 0, 0, 0, 0]);
  }

  /** How many bodies the last picture had. */
  get drawn() {
    return this.shadows.count;
  }

  dispose() {
    for (const lot of [...this.lots.values(), this.shadows]) lot.dispose();
  }
}

const COLUMNS = ["stand", "stretch", "paint"];

/** Many bodies alike: a geometry with rows of twelve numbers, four in each column. */
class Lot {
  constructor(geometry, material, order) {
    this.geometry = new InstancedBufferGeometry();
    for (const [name, attribute] of Object.entries(geometry.attributes)) this.geometry.setAttribute(name, attribute);
    this.geometry.setIndex(geometry.index);
    this.mesh = new Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = order;
    this.count = 0;
    this.#grow(16);
  }

  #grow(room) {
    for (const name of COLUMNS) {
      const before = this.geometry.getAttribute(name)?.array;
      const column = new InstancedBufferAttribute(new Float32Array(room * 4), 4);
      column.setUsage(DynamicDrawUsage);
      if (before) column.array.set(before);
      this.geometry.setAttribute(name, column);
    }
    this.room = room;
  }

  clear() {
    this.count = 0;
  }

  add(row) {
    if (this.count === this.room) {
      // A buffer on the graphics card has a fixed size: dispose of it, and three.js makes another.
      this.geometry.dispose();
      this.#grow(this.room * 2);
    }
    COLUMNS.forEach((name, k) => this.geometry.getAttribute(name).array.set(row.slice(4 * k, 4 * k + 4), 4 * this.count));
    this.count++;
  }

  commit() {
    this.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    for (const name of COLUMNS) this.geometry.getAttribute(name).needsUpdate = true;
  }

  dispose() {
    this.geometry.dispose();
    this.mesh.material.dispose();
  }
}

function shadowQuad() {
  const quad = new PlaneGeometry(1, 1);
  quad.rotateX(-Math.PI / 2);
  return quad;
}

/** A soft dark patch under a body, painted on the ground. */
function shadowMaterial() {
  return new ShaderMaterial({
    blending: CustomBlending, // not "transparent", which would be drawn after the bodies
    depthTest: false,
    depthWrite: false,
    vertexShader: /* glsl */ `
      attribute vec4 stand, stretch;
      varying vec2 at;
      varying vec2 size;
      varying float far;
      void main() {
        at = position.xz * stretch.xz;
        size = stretch.xz * 0.5;
        vec2 p = vec2(stand.z * at.x + stand.w * at.y, -stand.w * at.x + stand.z * at.y) + stand.xy;
        vec4 world = vec4(p.x, 0.0, p.y, 1.0);
        far = distance(cameraPosition, world.xyz);
        gl_Position = projectionMatrix * viewMatrix * world;
      }`,
    fragmentShader: /* glsl */ `
      varying vec2 at;
      varying vec2 size;
      varying float far;
      void main() {
        vec2 inner = smoothstep(vec2(0.0), vec2(0.42), size - abs(at));
        gl_FragColor = vec4(0.05, 0.055, 0.06, 0.62 * inner.x * inner.y * exp(-far * 0.006));
      }`,
  });
}
