// Many bodies alike, drawn at once: a geometry with a row of numbers for each body; and the soft shadows under bodies.

import { BufferAttribute, BufferGeometry, CustomBlending, DynamicDrawUsage, InstancedBufferAttribute, InstancedBufferGeometry, Mesh, OneFactor, PlaneGeometry, ShaderMaterial, ZeroFactor } from "three";

const COLUMNS = ["stand", "stretch", "paint"];

/** Many bodies alike: a geometry with rows of twelve numbers, four in each column, and with a label of each body. */
export class Lot {
  constructor(geometry, material, order, kind) {
    this.geometry = new InstancedBufferGeometry();
    for (const [name, attribute] of Object.entries(geometry.attributes)) this.geometry.setAttribute(name, attribute);
    this.geometry.setIndex(geometry.index);
    this.mesh = new Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.userData.kind = kind;
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
    const before = this.geometry.getAttribute("label")?.array;
    const labels = new InstancedBufferAttribute(new Float32Array(room), 1);
    labels.setUsage(DynamicDrawUsage);
    if (before) labels.array.set(before);
    this.geometry.setAttribute("label", labels);
    this.room = room;
  }

  clear() {
    this.count = 0;
  }

  add(row, label = 0) {
    if (this.count === this.room) {
      // A buffer on the graphics card has a fixed size: dispose of it, and three.js makes another.
      this.geometry.dispose();
      this.#grow(this.room * 2);
    }
    COLUMNS.forEach((name, k) => {
      const column = this.geometry.getAttribute(name).array;
      for (let i = 0; i < 4; i++) column[4 * this.count + i] = row[4 * k + i];
    });
    this.geometry.getAttribute("label").array[this.count] = label;
    this.count++;
  }

  commit() {
    this.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    for (const name of [...COLUMNS, "label"]) this.geometry.getAttribute(name).needsUpdate = true;
  }

  dispose() {
    this.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/**
 * One geometry of many bodies that never move, each [a geometry, a row as of a `Lot`]: without a graphics card that is far
 * quicker than as many instances.
 */
export function merged(bodies) {
  const corners = bodies.reduce((sum, [{ attributes }]) => sum + attributes.position.count, 0);
  const made = { position: new Float32Array(3 * corners), normal: new Float32Array(3 * corners), tint: new Uint8Array(4 * corners), surface: new Uint8Array(4 * corners) };
  const index = [];
  let first = 0;
  for (const [geometry, row] of bodies) {
    put(made, first, geometry.attributes, row);
    for (const corner of geometry.index.array) index.push(first + corner);
    first += geometry.attributes.position.count;
  }
  const whole = new BufferGeometry();
  whole.setIndex(index);
  for (const name of ["position", "normal"]) whole.setAttribute(name, new BufferAttribute(made[name], 3));
  for (const name of ["tint", "surface"]) whole.setAttribute(name, new BufferAttribute(made[name], 4, true));
  return whole;
}

/** Write the corners of a body, moved and painted by its row, from the place `first` on. */
function put(made, first, { position, normal, tint, surface }, [X, Z, c, s, along, up, across, , ...coat]) {
  for (let i = 0; i < position.count; i++) {
    const at = first + i;
    const [x, z] = [position.getX(i) * along, position.getZ(i) * across];
    made.position.set([c * x + s * z + X, position.getY(i) * up, -s * x + c * z + Z], 3 * at);
    const [nx, nz] = [normal.getX(i), normal.getZ(i)];
    made.normal.set([c * nx + s * nz, normal.getY(i), -s * nx + c * nz], 3 * at);
    const share = tint.getW(i);
    for (let j = 0; j < 3; j++) made.tint[4 * at + j] = 255 * (tint.getComponent(i, j) * (1 - share) + coat[j] * share);
  }
  made.surface.set(surface.array, 4 * first);
}

/** Shadows of bodies. */
export const shadows = () => new Lot(shadowQuad(), shadowMaterial(), -1, "shadow");

/** The row of a shadow of some length and width [m] about a place of the scene, with cos and sin of its heading; its edge
 * is so soft [m]. */
export const shadowRow = (X, Z, c, s, length, width, soft = 0.42) => [X, Z, c, s, length, soft, width, 0, 0, 0, 0, 0];

function shadowQuad() {
  const quad = new PlaneGeometry(1, 1);
  quad.rotateX(-Math.PI / 2);
  return quad;
}

/** A soft dark patch under a body, painted on the ground. */
function shadowMaterial() {
  return new ShaderMaterial({
    // Not "transparent", which would be drawn after the bodies; the picture itself stays opaque.
    blending: CustomBlending,
    blendSrcAlpha: ZeroFactor,
    blendDstAlpha: OneFactor,
    depthWrite: false,
    vertexShader: /* glsl */ `
      attribute vec4 stand, stretch;
      varying vec2 at;
      varying vec2 size;
      varying float far, soft;
      void main() {
        soft = stretch.y;
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
      varying float far, soft;
      void main() {
        // How deep inside a rectangle with rounded corners.
        vec2 beyond = max(abs(at) - size + soft, 0.0);
        float inner = smoothstep(0.0, 1.0, 1.0 - length(beyond) / soft);
        gl_FragColor = vec4(0.05, 0.055, 0.06, 0.62 * inner * exp(-far * 0.006));
      }`,
  });
}
