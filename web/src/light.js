// The light of a scene: sun and sky by the time of day and the weather, street lamps and headlights in the dark. The uniforms
// are shared by all materials that are made after `setLight`, until it is called again.

import { Color, Vector3, Vector4 } from "three";

export const [LAMPS, BEAMS] = [10, 6]; //: how many street lamps and cars' headlights light a picture: the nearest

//: by the time of day: direction to the sun; light of sun, sky and ground (linear); colours of the sky (sRGB) and how they
//: look in paint and glass (linear); how dense the haze is [1/m]; whether lamps are lit
const TIMES = {
  day: {
    sun: [-0.45, 0.72, 0.53], sunlight: [0.92, 0.86, 0.76], skylight: [0.48, 0.54, 0.62], earthlight: [0.2, 0.19, 0.17],
    sky: { zenith: "#5f9bd6", horizon: "#dfe7ea", haze: "#d3dcdf", far: "#aebbb4" },
    mirrored: { horizon: [0.78, 0.82, 0.86], zenith: [0.2, 0.38, 0.66] }, density: 0.0025, lit: false,
  },
  dusk: {
    sun: [-0.92, 0.14, 0.36], sunlight: [0.34, 0.19, 0.09], skylight: [0.15, 0.15, 0.21], earthlight: [0.06, 0.055, 0.06],
    sky: { zenith: "#34466b", horizon: "#d59a72", haze: "#8d7f80", far: "#4a4a50" },
    mirrored: { horizon: [0.5, 0.3, 0.2], zenith: [0.04, 0.07, 0.16] }, density: 0.0028, lit: true,
  },
  night: {
    sun: [-0.3, 0.9, 0.3], sunlight: [0.006, 0.007, 0.01], skylight: [0.012, 0.013, 0.018], earthlight: [0.006, 0.006, 0.006],
    sky: { zenith: "#070a12", horizon: "#1a1c22", haze: "#131519", far: "#0b0d0e" },
    mirrored: { horizon: [0.012, 0.013, 0.016], zenith: [0.002, 0.003, 0.006] }, density: 0.003, lit: true,
  },
};
export const TIMES_OF_DAY = Object.keys(TIMES);

//: what rain leaves of the sun, and what it makes of the sky: its light is evened out and grey
const RAIN = { sun: 0.12, sky: 0.78, grey: 0.75, density: 2.6 };

let present = made("day", false);

/** Light everything that is made from now on so: by the time of day, and in rain or not. */
export function setLight(time = "day", rain = false) {
  if (!TIMES[time]) throw new Error(`no time of day ${time}: there are ${TIMES_OF_DAY.join(", ")}`);
  present = made(time, rain);
  return present;
}

function made(time, rain) {
  const { sun, sunlight, skylight, earthlight, sky, mirrored, density, lit } = TIMES[time];
  const grey = (colour) => {
    const { r, g, b } = new Color(colour);
    const mean = 0.3 * r + 0.55 * g + 0.15 * b;
    const share = rain ? RAIN.grey : 0;
    return new Color(...[r, g, b].map((value) => (value + (0.82 * mean - value) * share)));
  };
  const colours = Object.fromEntries(Object.entries(sky).map(([name, colour]) => [name, grey(colour)]));
  if (rain) colours.zenith.lerp(colours.horizon, 0.75);
  const vector = (values, share = 1) => new Vector3(...values).multiplyScalar(share);
  const [high, low] = rain ? [mirrored.horizon.map((value) => 0.7 * value), mirrored.horizon.map((value) => 0.8 * value)] : [mirrored.zenith, mirrored.horizon];
  return {
    sky: colours,
    lit,
    rain,
    uniforms: {
      sun: { value: new Vector3(...sun).normalize() },
      haze: { value: colours.haze },
      sunlight: { value: vector(sunlight, rain ? RAIN.sun : 1) },
      skylight: { value: vector(skylight, rain ? RAIN.sky : 1) },
      earthlight: { value: vector(earthlight) },
      horizon: { value: vector(low) },
      zenith: { value: vector(high) },
      density: { value: density * (rain ? RAIN.density : 1) },
      ...(lit ? { lamps: { value: Array.from({ length: LAMPS }, () => new Vector4()) }, beams: { value: Array.from({ length: BEAMS }, () => new Vector4()) } } : {}),
    },
  };
}

export const lightUniforms = () => present.uniforms;
export const lampsLit = () => present.lit;
export const rains = () => present.rain;
export const skyColours = () => present.sky;
