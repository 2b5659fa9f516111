// From the map to the scene of three.js and back. The map: x east, y north, headings counter-clockwise from east.
// The scene: X east, Y up, Z south, about an origin near the drive, because the graphics card counts in 32 bits.

export class Reference {
  constructor(originX, originY) {
    this.originX = originX;
    this.originY = originY;
  }

  /** Scene coordinates of a point of the map at a height over the road [m]. */
  place(x, y, height = 0) {
    return [x - this.originX, height, this.originY - y];
  }

  /** Map coordinates and height of a point of the scene [m]. */
  back(X, Y, Z) {
    return { x: X + this.originX, y: this.originY - Z, height: Y };
  }
}

/** The middle of all points that a scene is made of. */
export function referenceOf(scene) {
  const points = scene.path?.length ? scene.path : scene.lanes.flatMap((lane) => lane.points);
  if (!points.length) return new Reference(0, 0);
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const [x, y] of points) {
    left = Math.min(left, x);
    right = Math.max(right, x);
    low = Math.min(low, y);
    high = Math.max(high, y);
  }
  return new Reference(Math.round((left + right) / 2), Math.round((low + high) / 2));
}

//: a pose is not predicted over more than this [s]: a car whose poses have stopped coming must not drive on
export const LONGEST_PREDICTION = 0.25;

/** Where a pose {x, y, heading} with speed [m/s] and yaw rate [rad/s] is after some seconds, both kept constant. */
export function predicted(pose, seconds) {
  const time = Math.min(Math.max(seconds, -LONGEST_PREDICTION), LONGEST_PREDICTION);
  const { x, y, heading } = pose;
  const speed = pose.speed ?? 0;
  const turned = (pose.yaw_rate ?? 0) * time;
  // The chord of the circular arc: its length is speed · time · sin(turned / 2) / (turned / 2).
  const half = turned / 2;
  const chord = speed * time * (Math.abs(half) < 1e-6 ? 1 - (half * half) / 6 : Math.sin(half) / half);
  return {
    x: x + chord * Math.cos(heading + half),
    y: y + chord * Math.sin(heading + half),
    heading: heading + turned,
  };
}
