// How everything is shaded: sun and sky at the vertices, haze with distance. One small shader for all bodies and one
// for the ground, because the pictures are also made without a graphics card. Colours are mixed in linear light and
// leave the vertices in sRGB.

import { Color, ColorManagement, DataTexture, LinearMipmapLinearFilter, LinearFilter, RepeatWrapping, RGBAFormat, ShaderMaterial } from "three";
import { BEAMS, LAMPS, lampsLit, lightUniforms, rains } from "./light.js";

ColorManagement.enabled = false; // the shaders below do it themselves

const LIGHT = /* glsl */ `
  uniform vec3 sun, haze, sunlight, skylight, earthlight, zenith, horizon;
  uniform float density;
  vec3 linear(vec3 c) { return c * c * (0.3 * c + 0.7); }
  vec3 screen(vec3 c) { return sqrt(max(c, 0.0)) * (1.0 + 0.06 * (1.0 - c)); }
  vec3 lit(vec3 albedo, vec3 n) {
    float up = 0.5 + 0.5 * n.y;
    return albedo * (mix(earthlight, skylight, up) + sunlight * max(dot(n, sun), 0.0));
  }
  float hazed(float distance) { float far = distance * density; return 1.0 - exp(-far * far); }
`;

//: street lamps and headlights, which a picture at night has; where they are is said picture by picture
const NIGHT_LIGHT = /* glsl */ `
  uniform vec4 lamps[${LAMPS}];     // X, Y, Z, strength
  uniform vec4 beams[${BEAMS}];     // X, Z, cos and sin of the heading; none where all are 0
  vec3 lamplight(vec3 at, vec3 n) {
    vec3 sum = vec3(0.0);
    for (int i = 0; i < ${LAMPS}; i++) {
      vec3 way = lamps[i].xyz - at;
      float square = dot(way, way);
      vec3 to = way * inversesqrt(square);
      sum += lamps[i].w * vec3(1.0, 0.83, 0.58) * max(dot(n, to), 0.0) * max(to.y, 0.0) / (square + 4.0);
    }
    for (int i = 0; i < ${BEAMS}; i++) {
      vec3 way = vec3(beams[i].x, 0.65, beams[i].y) - at;
      vec3 ahead = vec3(beams[i].z, -0.03, -beams[i].w);
      float square = dot(way, way);
      vec3 to = way * inversesqrt(square);
      // Wide to both sides, narrow upwards: a low beam.
      float along = max(dot(-to, ahead), 0.0);
      float above = dot(-to, vec3(0.0, 1.0, 0.0)) + 0.015;
      float shape = smoothstep(0.82, 0.99, along) * (1.0 - smoothstep(-0.005, 0.03, above));
      float spill = 0.03 * smoothstep(0.6, 0.98, along);
      sum += 90.0 * vec3(1.0, 0.97, 0.9) * (shape + spill) * (0.25 + 0.75 * max(dot(n, to), 0.0)) / (square + 30.0);
    }
    return sum;
  }
`;

//: for the pass that says what a pixel shows: by whom it is owned, and how far along the axis it is
const TRUTH_VERTEX = /* glsl */ `
  #ifdef TRUTH
    #ifdef INSTANCED
      owner = label;
    #else
      owner = own;
    #endif
    if (only >= 0.0 && abs(owner - only) > 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  #endif
`;
const TRUTH_HEAD = /* glsl */ `
  #ifdef TRUTH
    #ifdef INSTANCED
      attribute float label;
    #endif
    uniform float own, only;
    varying float owner;
  #endif
`;
const TRUTH_FRAGMENT = /* glsl */ `
  varying float owner;
  uniform float kind;
  // The reciprocal of gl_FragCoord.w is the distance along the axis.
  void main() { gl_FragColor = vec4(floor(owner + 0.5), kind, 1.0 / gl_FragCoord.w, 1.0); }
`;

const BODY_VERTEX = /* glsl */ `
  attribute vec4 tint;      // sRGB albedo, and the share of it that the paint replaces
  attribute vec4 surface;   // gloss, light of its own, limb (0.5 none), height of the limb's joint [2 m]
  #ifdef INSTANCED
    attribute vec4 stand;   // X, Z, cos and sin of the heading
    attribute vec4 stretch; // along, up, across; phase of the gait
    attribute vec4 paint;   // sRGB, and the swing of the gait [rad]
  #else
    uniform vec3 coat;
  #endif
  varying vec3 shade;
  #if defined(NIGHT) || defined(GRAIN) || defined(FACADE)
    varying vec3 at, facing3;
    varying vec4 own4;      // albedo, share of the picture that the haze leaves
  #endif
  #ifdef FACADE
    varying float pattern;
  #endif
  ${TRUTH_HEAD}
  ${LIGHT}
  void main() {
    vec3 p = position, n = normal;
    #ifdef INSTANCED
      float angle = (surface.z - 0.5) * 2.0 * paint.w * sin(stretch.w);
      float c = cos(angle), s = sin(angle);
      float joint = surface.w * 2.0;
      p = vec3(c * p.x - s * (p.y - joint), s * p.x + c * (p.y - joint) + joint, p.z);
      n = vec3(c * n.x - s * n.y, s * n.x + c * n.y, n.z);
      p *= stretch.xyz;
      n = normalize(n / stretch.xyz);
      p = vec3(stand.z * p.x + stand.w * p.z + stand.x, p.y, -stand.w * p.x + stand.z * p.z + stand.y);
      n = vec3(stand.z * n.x + stand.w * n.z, n.y, -stand.w * n.x + stand.z * n.z);
      vec3 coat = paint.rgb;
      vec4 world = vec4(p, 1.0);
    #else
      vec4 world = modelMatrix * vec4(p, 1.0);
      n = normalize(mat3(modelMatrix) * n);
    #endif
    vec3 albedo = linear(mix(tint.rgb, coat, tint.a));
    vec3 toEye = cameraPosition - world.xyz;
    float far = length(toEye);
    vec3 eye = toEye / far;
    vec3 bounced = reflect(-eye, n);
    float facing = 1.0 - max(dot(n, eye), 0.0);
    float mirror = surface.x * (0.10 + 0.75 * facing * facing * facing);
    vec3 sky = mix(earthlight * 0.85, mix(horizon, zenith, clamp(bounced.y * 1.3, 0.0, 1.0)), smoothstep(-0.08, 0.06, bounced.y));
    vec3 light = mix(lit(albedo, n), sky, mirror) + surface.x * sunlight * pow(max(dot(bounced, sun), 0.0), 36.0);
    #ifdef NIGHT
      light = mix(light, albedo * 2.5, min(1.0, 2.0 * surface.y));
    #else
      light = mix(light, albedo * 1.6, surface.y);
    #endif
    #if defined(NIGHT) || defined(GRAIN) || defined(FACADE)
      at = world.xyz;
      facing3 = n;
      own4 = vec4(albedo * (1.0 - 0.6 * surface.x), 1.0 - hazed(far));
      shade = light;
    #else
      shade = mix(screen(light), haze, hazed(far));
    #endif
    #ifdef FACADE
      pattern = surface.z;
    #endif
    gl_Position = projectionMatrix * viewMatrix * world;
    ${TRUTH_VERTEX}
  }
`;

const BODY_FRAGMENT = /* glsl */ `
  varying vec3 shade;
  #if defined(NIGHT) || defined(GRAIN) || defined(FACADE)
    varying vec3 at, facing3;
    varying vec4 own4;
    ${LIGHT}
  #endif
  #ifdef NIGHT
    ${NIGHT_LIGHT}
  #endif
  #if defined(GRAIN) || defined(FACADE)
    uniform sampler2D grain;
    uniform float fine, rough;
  #endif
  #ifdef FACADE
    varying float pattern;
  #endif
  void main() {
    #if defined(NIGHT) || defined(GRAIN) || defined(FACADE)
      vec3 light = shade;
      #ifdef NIGHT
        light += own4.rgb * lamplight(at, normalize(facing3));
      #endif
      #if defined(GRAIN) || defined(FACADE)
        vec3 side = abs(facing3);
        vec2 flat2 = side.y > max(side.x, side.z) ? at.xz : vec2(side.x > side.z ? at.z : at.x, at.y);
        float g = texture2D(grain, flat2 * fine).r - 0.5;
        light *= max(0.0, 1.0 + rough * g);
      #endif
      #ifdef FACADE
        // Boards of a wall, rows of shingles of a roof: finer than a pixel they are left out.
        float rows = pattern > 0.75 ? at.y * 6.5 : (at.x + at.y + at.z) * 3.2;
        float sharp = clamp(1.0 - fwidth(rows) * 1.6, 0.0, 1.0);
        float line = smoothstep(0.78, 0.95, fract(rows));
        light *= pattern > 0.75 || pattern < 0.25 ? 1.0 - 0.28 * line * sharp : 1.0;
      #endif
      gl_FragColor = vec4(mix(haze, screen(light), own4.a), 1.0);
    #else
      gl_FragColor = vec4(shade, 1.0);
    #endif
  }
`;

const GROUND_VERTEX = /* glsl */ `
  attribute vec3 tint;
  varying vec3 shade;
  varying vec3 at;
  ${TRUTH_HEAD}
  ${LIGHT}
  void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    at = world.xyz;
    #ifdef NIGHT
      shade = linear(tint);
    #else
      shade = screen(lit(linear(tint), vec3(0.0, 1.0, 0.0)));
    #endif
    gl_Position = projectionMatrix * viewMatrix * world;
    ${TRUTH_VERTEX}
  }
`;

const GROUND_FRAGMENT = /* glsl */ `
  varying vec3 shade;
  varying vec3 at;
  uniform sampler2D grain;
  uniform float fine, rough;
  ${LIGHT}
  #ifdef NIGHT
    ${NIGHT_LIGHT}
  #endif
  void main() {
    vec3 away = cameraPosition - at;
    float far = length(away);
    float g = texture2D(grain, at.xz * fine).r - 0.5;
    #ifdef NIGHT
      vec3 up = vec3(0.0, 1.0, 0.0);
      vec3 painted = screen(lit(shade, up) + shade * lamplight(at, up)) * (1.0 + rough * g);
    #else
      vec3 painted = shade * (1.0 + rough * g);
    #endif
    #ifdef WET
      // A wet road is darker, and mirrors the sky where one looks along it.
      float grazing = 1.0 - away.y / far;
      painted = mix(0.7 * painted, screen(horizon), 0.55 * pow(grazing, 6.0) * (0.7 + g));
    #endif
    gl_FragColor = vec4(mix(haze, painted, 1.0 - hazed(far)), 1.0);
  }
`;

/**
 * The material of bodies: of many alike, or of one with a coat of paint. With `rough` their surface has grain, of so many
 * cells a metre; a `facade` has boards and shingles where the limb of its corners is 1 and -1.
 */
export function bodyMaterial({ instanced = false, coat = "#ffffff", rough = 0, fine = 0.5, facade = false } = {}) {
  const grained = rough > 0 || facade ? { grain: { value: grain() }, fine: { value: fine }, rough: { value: rough } } : {};
  return new ShaderMaterial({
    vertexShader: BODY_VERTEX,
    fragmentShader: BODY_FRAGMENT,
    uniforms: { ...lightUniforms(), ...grained, ...(instanced ? {} : { coat: { value: new Color(coat) } }) },
    defines: { ...(instanced ? { INSTANCED: "" } : {}), ...(rough > 0 ? { GRAIN: "" } : {}), ...(facade ? { FACADE: "" } : {}), ...weather() },
  });
}

/** The material of what is painted flat on the ground: grain of so many cells a metre, so rough. */
export function groundMaterial({ fine, rough }) {
  return new ShaderMaterial({
    vertexShader: GROUND_VERTEX,
    fragmentShader: GROUND_FRAGMENT,
    uniforms: { ...lightUniforms(), grain: { value: grain() }, fine: { value: fine }, rough: { value: rough } },
    defines: weather(),
    depthWrite: false,
  });
}

const weather = () => ({ ...(lampsLit() ? { NIGHT: "" } : {}), ...(rains() ? { WET: "" } : {}) });

/**
 * The material by which a body or the ground says what its pixels show: owner, kind and depth. `own` is the owner of a
 * body that is no instance; `only` is a uniform: what has another owner is left out, nothing where it is below 0.
 */
export function truthMaterial(material, kind, own, only) {
  return new ShaderMaterial({
    vertexShader: material.vertexShader,
    fragmentShader: TRUTH_FRAGMENT,
    uniforms: { ...material.uniforms, kind: { value: kind }, own: { value: own }, only },
    defines: { ...material.defines, TRUTH: "" },
    depthWrite: material.depthWrite,
  });
}

let sharedGrain = null;

/** A small texture of smooth noise about one half, the same every time. */
function grain() {
  if (sharedGrain) return sharedGrain;
  const size = 256;
  const values = new Float32Array(size * size);
  for (const [cells, weight] of [[8, 0.25], [32, 0.3], [128, 0.45]]) addNoise(values, size, cells, weight);
  const data = new Uint8Array(size * size * 4);
  values.forEach((value, i) => data.fill(Math.round(255 * (0.5 + value)), 4 * i, 4 * i + 4));
  sharedGrain = new DataTexture(data, size, size, RGBAFormat);
  sharedGrain.wrapS = sharedGrain.wrapT = RepeatWrapping;
  sharedGrain.magFilter = LinearFilter;
  sharedGrain.minFilter = LinearMipmapLinearFilter;
  sharedGrain.generateMipmaps = true;
  sharedGrain.needsUpdate = true;
  return sharedGrain;
}

/** Add noise of some cells a side, -weight/2 to weight/2, that fits to itself at the edges. */
function addNoise(values, size, cells, weight) {
  const corner = (i, j) => hashed((i % cells) * 374761393 + (j % cells) * 668265263 + cells) - 0.5;
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const [u, v] = [(x * cells) / size, (y * cells) / size];
      const [i, j] = [Math.floor(u), Math.floor(v)];
      const [a, b] = [u - i, v - j];
      const low = corner(i, j) * (1 - a) + corner(i + 1, j) * a;
      const high = corner(i, j + 1) * (1 - a) + corner(i + 1, j + 1) * a;
      values[y * size + x] += weight * (low * (1 - b) + high * b);
    }
  }
}

/** A number from 0 to 1 that an integer always gets, and that says nothing of it. */
export function hashed(n) {
  let h = Math.imul(n | 0, 0x9e3779b1) ^ 0x5bd1e995;
  h = Math.imul(h ^ (h >>> 15), 0x85ebca6b);
  h = Math.imul(h ^ (h >>> 13), 0xc2b2ae35);
  return ((h ^ (h >>> 16)) >>> 0) / 4294967296;
}

/** `hashed` of a text. */
export function hashedText(text) {
  let h = 2166136261;
  for (let i = 0; i < text.length; i++) h = Math.imul(h ^ text.charCodeAt(i), 16777619);
  return hashed(h);
}
