// How everything is shaded: sun and sky at the vertices, haze with distance. One small shader for all bodies and one
// for the ground, because the pictures are also made without a graphics card. Colours are mixed in linear light and
// leave the vertices in sRGB.

import { Color, ColorManagement, DataTexture, LinearMipmapLinearFilter, LinearFilter, RepeatWrapping, RGBAFormat, ShaderMaterial, Vector3 } from "three";

ColorManagement.enabled = false; // the shaders below do it themselves

export const SKY = { zenith: "#5f9bd6", horizon: "#dfe7ea", haze: "#d3dcdf" };
const SUN = new Vector3(-0.45, 0.72, 0.53).normalize();

const LIGHT = /* glsl */ `
  uniform vec3 sun, haze;
  vec3 linear(vec3 c) { return c * c * (0.3 * c + 0.7); }
  vec3 screen(vec3 c) { return sqrt(max(c, 0.0)) * (1.0 + 0.06 * (1.0 - c)); }
  vec3 lit(vec3 albedo, vec3 n) {
    float up = 0.5 + 0.5 * n.y;
    vec3 sky = mix(vec3(0.20, 0.19, 0.17), vec3(0.48, 0.54, 0.62), up);
    return albedo * (sky + vec3(0.92, 0.86, 0.76) * max(dot(n, sun), 0.0));
  }
  float hazed(float distance) { float far = distance * 0.0025; return 1.0 - exp(-far * far); }
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
    vec3 sky = mix(vec3(0.16, 0.16, 0.15), mix(vec3(0.78, 0.82, 0.86), vec3(0.20, 0.38, 0.66), clamp(bounced.y * 1.3, 0.0, 1.0)),
      smoothstep(-0.08, 0.06, bounced.y));
    vec3 light = mix(lit(albedo, n), sky, mirror) + surface.x * 0.9 * pow(max(dot(bounced, sun), 0.0), 36.0);
    light = mix(light, albedo * 1.6, surface.y);
    shade = mix(screen(light), haze, hazed(far));
    gl_Position = projectionMatrix * viewMatrix * world;
  }
`;

const BODY_FRAGMENT = /* glsl */ `
  varying vec3 shade;
  void main() { gl_FragColor = vec4(shade, 1.0); }
`;

const GROUND_VERTEX = /* glsl */ `
  attribute vec3 tint;
  varying vec3 shade;
  varying vec3 at;
  ${LIGHT}
  void main() {
    shade = screen(lit(linear(tint), vec3(0.0, 1.0, 0.0)));
    vec4 world = modelMatrix * vec4(position, 1.0);
    at = world.xyz;
    gl_Position = projectionMatrix * viewMatrix * world;
  }
`;

const GROUND_FRAGMENT = /* glsl */ `
  varying vec3 shade;
  varying vec3 at;
  uniform sampler2D grain;
  uniform vec3 haze;
  uniform float fine, rough;
  void main() {
    vec3 away = (at - cameraPosition) * 0.0025;
    float clear = exp(-dot(away, away));
    float g = texture2D(grain, at.xz * fine).r - 0.5;
    gl_FragColor = vec4(mix(haze, shade * (1.0 + rough * g), clear), 1.0);
  }
`;

const uniforms = () => ({ sun: { value: SUN }, haze: { value: new Color(SKY.haze) } });

/** The material of bodies: of many alike, or of one with a coat of paint. */
export function bodyMaterial({ instanced = false, coat = "#ffffff" } = {}) {
  return new ShaderMaterial({
    vertexShader: BODY_VERTEX,
    fragmentShader: BODY_FRAGMENT,
    uniforms: { ...uniforms(), ...(instanced ? {} : { coat: { value: new Color(coat) } }) },
    defines: instanced ? { INSTANCED: "" } : {},
  });
}

/** The material of what is painted flat on the ground: grain of so many cells a metre, so rough. */
export function groundMaterial({ fine, rough }) {
  return new ShaderMaterial({
    vertexShader: GROUND_VERTEX,
    fragmentShader: GROUND_FRAGMENT,
    uniforms: { ...uniforms(), grain: { value: grain() }, fine: { value: fine }, rough: { value: rough } },
    depthWrite: false,
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
