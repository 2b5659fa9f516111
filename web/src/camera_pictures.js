// The pictures of a camera on the car, and the truth beside them: what every pixel shows, whose it is and how far. The
// street is drawn on a plane as a pinhole sees it, and then looked up through the lens.

import { DataTexture, FloatType, LinearFilter, Mesh, NearestFilter, OrthographicCamera, PlaneGeometry, RGBAFormat, RGFormat, Scene, ShaderMaterial, Vector2, Vector3, Vector4, WebGLRenderTarget } from "three";
import { truthMaterial } from "./shading.js";

//: what a pixel may show; its number in the picture of kinds
export const KINDS = ["nothing", "ground", "walk", "road", "marks", "kerb", "building", "vegetation", "pole", "signal", "vehicle", "two_wheeler", "person", "ego"];
const BODIES = new Set(["vehicle", "two_wheeler", "person"]);
const CENTIMETRES = 100;
const FARTHEST = 65534; //: that a picture of depths holds [cm]
const MULTISAMPLES = 4; //: of a pixel's edge

export class CameraPictures {
  /**
   * Pictures of a world for a camera {columns, rows, mount, plane: {columns, rows, slopes}, map}: the plane's size in
   * pixels and the slopes of its edges; for every pixel of the picture, row by row from the upper left, where it looks on
   * the plane, as shares of its width and height, two 32-bit numbers each.
   */
  constructor(world, { columns, rows, mount, plane, map }) {
    this.world = world;
    this.size = { columns, rows };
    this.plane = plane;
    this.map = map;
    world.mount(mount, plane.slopes);
    world.renderer.setPixelRatio(1);
    world.renderer.setSize(columns, rows, false);
    this.drawn = new WebGLRenderTarget(plane.columns, plane.rows, { samples: MULTISAMPLES, minFilter: LinearFilter, magFilter: LinearFilter });
    this.truth = new WebGLRenderTarget(plane.columns, plane.rows, { type: FloatType, format: RGBAFormat, minFilter: NearestFilter, magFilter: NearestFilter });
    this.only = { value: -1 };
    this.materials = new Map();
    this.#throughTheLens();
  }

  #throughTheLens() {
    const { columns, rows } = this.size;
    const lookup = new DataTexture(this.map, columns, rows, RGFormat, FloatType);
    lookup.needsUpdate = true;
    const { rain } = this.world.light;
    this.lens = lensMaterial(this.drawn.texture, lookup, this.size, rain, this.world.light.lit);
    this.sheet = new Scene();
    const quad = new Mesh(new PlaneGeometry(2, 2), this.lens);
    quad.frustumCulled = false;
    this.sheet.add(quad);
    this.flat = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  }

  /** Draw a frame at a drive time [s] on the canvas. */
  draw(frame, time) {
    const { world } = this;
    world.show(frame, time);
    world.renderer.setRenderTarget(this.drawn);
    world.draw();
    world.renderer.setRenderTarget(null);
    this.lens.uniforms.time.value = time % 64;
    world.renderer.render(this.sheet, this.flat);
  }

  /**
   * The truth of the picture that was drawn last, row by row from the upper left: `kinds` (8 bit), `owners` (16 bit: 0
   * nobody, else the place in `bodies` from 1), `depths` (16 bit, along the axis, in centimetres, 0 for nothing); `ego` where
   * the rear axle is, and `bodies` with `pixels` that each has on the plane, and `alone`, those that it would have there without anything before it.
   */
  look() {
    const { columns, rows } = this.size;
    const { plane, map } = this;
    const seen = this.#pass(null, this.#meshes());
    const count = columns * rows;
    const [kinds, owners, depths] = [new Uint8Array(count), new Uint16Array(count), new Uint16Array(count)];
    for (let i = 0; i < count; i++) {
      const at = 4 * (Math.floor((1 - map[2 * i + 1]) * plane.rows) * plane.columns + Math.floor(map[2 * i] * plane.columns));
      owners[i] = seen[at];
      kinds[i] = seen[at + 1];
      depths[i] = seen[at + 1] ? Math.min(Math.round(seen[at + 2] * CENTIMETRES), FARTHEST) : 0;
    }
    const { car } = this.world.cameraPose();
    return { kinds, owners, depths, bodies: this.#bodies(seen), ego: car };
  }

  #bodies(seen) {
    const pixels = new Map();
    for (let i = 0; i < seen.length; i += 4) if (seen[i] > 0) pixels.set(seen[i], (pixels.get(seen[i]) ?? 0) + 1);
    const meshes = this.#meshes().filter(({ userData }) => BODIES.has(userData.kind));
    return this.world.fleet.bodies.map((body, k) => {
      const own = pixels.get(k + 1) ?? 0;
      return { ...body, pixels: own, alone: own ? this.#alone(body, k + 1, meshes) : 0 };
    });
  }

  /** How many pixels of the plane a body would have if it were alone. */
  #alone(body, label, meshes) {
    const window = this.#window(body);
    const seen = this.#pass(window, meshes, label);
    let count = 0;
    for (let i = 0; i < seen.length; i += 4) if (seen[i] === label) count++;
    return count;
  }

  /** The part of the plane that a body may be in, in pixels from the lower left. */
  #window({ x, y, heading, length, width, height }) {
    const { plane, world } = this;
    const [c, s] = [Math.cos(heading), Math.sin(heading)];
    let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const i of [-0.65, 0.65]) for (const j of [-0.9, 0.9]) for (const up of [-0.05, 1.1]) {
      const [along, across] = [i * Math.max(length, 1), j * Math.max(width, 0.8)];
      const at = new Vector4(...world.reference.place(x + c * along - s * across, y + s * along + c * across, up * height), 1);
      at.applyMatrix4(world.camera.matrixWorldInverse).applyMatrix4(world.camera.projectionMatrix);
      // Beside the camera: anywhere.
      if (at.w < 0.2) return [0, 0, plane.columns, plane.rows];
      const [u, v] = [(0.5 + (0.5 * at.x) / at.w) * plane.columns, (0.5 + (0.5 * at.y) / at.w) * plane.rows];
      [left, right, low, high] = [Math.min(left, u), Math.max(right, u), Math.min(low, v), Math.max(high, v)];
    }
    const within = (value, most) => Math.min(Math.max(Math.round(value), 0), most);
    const [first, last] = [within(left - 1, plane.columns - 1), within(right + 1, plane.columns)];
    const [bottom, top] = [within(low - 1, plane.rows - 1), within(high + 1, plane.rows)];
    return [first, bottom, Math.max(last - first, 1), Math.max(top - bottom, 1)];
  }

  /** Owner, kind and depth of each pixel of a window of the plane, four numbers each from the lower left. */
  #pass(window, meshes, only = -1) {
    const { world, plane, truth } = this;
    const [x, y, wide, high] = window ?? [0, 0, plane.columns, plane.rows];
    this.only.value = only;
    const hidden = this.#dressed(meshes);
    truth.scissor.set(x, y, wide, high);
    truth.scissorTest = window !== null;
    world.renderer.setRenderTarget(truth);
    world.renderer.setClearColor(0x000000, 0);
    world.renderer.render(world.scene, world.camera);
    const seen = new Float32Array(4 * wide * high);
    world.renderer.readRenderTargetPixels(truth, x, y, wide, high, seen);
    world.renderer.setRenderTarget(null);
    for (const [mesh, material, visible] of hidden) Object.assign(mesh, { material, visible });
    return seen;
  }

  /** Have the meshes say what they are, and hide all others; returns what was before. */
  #dressed(meshes) {
    const told = new Set(meshes);
    const before = [];
    this.world.scene.traverse((mesh) => {
      if (!mesh.isMesh) return;
      before.push([mesh, mesh.material, mesh.visible]);
      if (told.has(mesh)) mesh.material = this.#materialOf(mesh);
      else mesh.visible = false;
    });
    return before;
  }

  #materialOf({ material, userData: { kind } }) {
    const key = `${material.uuid} ${kind}`;
    if (!this.materials.has(key)) this.materials.set(key, truthMaterial(material, KINDS.indexOf(kind), 0, this.only));
    return this.materials.get(key);
  }

  #meshes() {
    const found = [];
    this.world.scene.traverseVisible((mesh) => {
      if (mesh.isMesh && KINDS.includes(mesh.userData.kind)) found.push(mesh);
    });
    return found;
  }

  /** Give everything back that the graphics card holds. */
  dispose() {
    for (const one of [this.drawn, this.truth, this.lens, ...this.materials.values()]) one.dispose();
    this.world.dispose();
  }
}

/** What looks the picture up on the plane; soft and with noise as cameras are, in rain with streaks, in the dark with the glare of lamps. */
function lensMaterial(drawn, lookup, { columns, rows }, rain, dark) {
  return new ShaderMaterial({
    depthTest: false,
    depthWrite: false,
    defines: { ...(rain ? { RAIN: "" } : {}), ...(dark ? { DARK: "" } : {}) },
    uniforms: {
      drawn: { value: drawn },
      lookup: { value: lookup },
      size: { value: new Vector2(columns, rows) },
      pixel: { value: new Vector2(1 / columns, 1 / rows) },
      tint: { value: new Vector3(0.75, 0.79, 0.83) },
      time: { value: 0 },
    },
    vertexShader: /* glsl */ `
      void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }`,
    fragmentShader: /* glsl */ `
      uniform sampler2D drawn, lookup;
      uniform vec2 size, pixel;
      uniform vec3 tint;
      uniform float time;
      float chance(vec2 p) { return fract(sin(dot(p, vec2(12.9898, 78.233)) + time * 3.7) * 43758.5453); }
      void main() {
        vec2 cell = vec2(gl_FragCoord.x, size.y - gl_FragCoord.y);
        vec2 place = texture2D(lookup, cell / size).xy;
        vec2 at = vec2(place.x, 1.0 - place.y);
        // A lens is a little soft: about 0.8 pixels (1 sigma).
        vec3 seen = vec3(0.0);
        for (int i = -2; i <= 2; i++) {
          for (int j = -2; j <= 2; j++) {
            float weight = exp(-float(i * i + j * j) / 1.28);
            seen += weight * texture2D(drawn, at + vec2(float(i), float(j)) * pixel).rgb;
          }
        }
        seen /= 4.0142;
        #ifdef DARK
          // Lamps are brighter than the picture can be: their light spills over.
          vec3 glare = vec3(0.0);
          for (int i = -3; i <= 3; i++) {
            for (int j = -3; j <= 3; j++) {
              vec3 near = texture2D(drawn, at + vec2(float(i), float(j)) * 2.2 * pixel).rgb;
              glare += max(near - 0.82, 0.0) / (1.0 + float(i * i + j * j));
            }
          }
          seen += 0.35 * glare;
        #endif
        #ifdef RAIN
          // Drops fall through a pixel while the picture is taken.
          vec2 streak = vec2(floor(cell.x / 2.0 + cell.y * 0.06), floor(cell.y / 46.0 + chance(vec2(floor(cell.x / 2.0 + cell.y * 0.06), 3.0)) * 9.0));
          float falls = step(0.985, chance(streak + 7.0));
          seen = mix(seen, tint * (0.35 + 0.65 * dot(seen, vec3(0.333))), 0.22 * falls);
        #endif
        // Noise of the sensor, about four steps of 255 (1 sigma): the sum of three chances of each colour.
        vec3 noise = vec3(-1.5);
        for (int k = 0; k < 3; k++) {
          vec2 at3 = floor(cell) + 17.0 * float(k);
          noise += vec3(chance(at3), chance(at3 + 311.0), chance(at3 + 577.0));
        }
        gl_FragColor = vec4(seen + 0.031 * noise, 1.0);
      }`,
  });
}
