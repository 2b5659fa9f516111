// The unit in which the page shows speeds, which a browser remembers.

const SPEED_UNITS = { "km/h": 3.6, mph: 1 / 0.44704 }; // of a metre a second; the international mile
const REMEMBERED = "vve-sumo speed unit";

let chosen = remembered();

/** The unit's name, and how many of it a metre a second is. */
export function speedUnit() {
  return { name: chosen, factor: SPEED_UNITS[chosen] };
}

/** The unit that `switchSpeedUnit` would choose. */
export function otherSpeedUnit() {
  return chosen === "mph" ? "km/h" : "mph";
}

/** Show speeds in the other unit from now on. */
export function switchSpeedUnit() {
  chosen = otherSpeedUnit();
  try {
    localStorage.setItem(REMEMBERED, chosen);
  } catch {
    // A page in a frame of its own, such as a notebook's, remembers nothing.
  }
}

function remembered() {
  try {
    const name = localStorage.getItem(REMEMBERED);
    return name in SPEED_UNITS ? name : "km/h";
  } catch {
    return "km/h";
  }
}
