// What every drawing shares: a canvas at the screen's own resolution, and the colours of the page's theme.

/** Return the 2-D context of a canvas, sized to its place on the page; coordinates are CSS pixels. */
export function sized(canvas) {
  const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== wide || canvas.height !== high) {
    canvas.width = wide;
    canvas.height = high;
  }
  const context = canvas.getContext("2d", { alpha: true });
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { context, width, height, ratio };
}

let palette = null;

/** Return a colour of the page's theme by its name. */
export function colour(name) {
  if (palette === null) palette = new Map();
  if (!palette.has(name)) {
    palette.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  }
  return palette.get(name);
}

/** Forget the colours, after the theme has changed. */
export function themeChanged() {
  palette = null;
}

/** Return a Path2D through points, closed or not. */
export function line(points, closed = false) {
  const path = new Path2D();
  points.forEach(([x, y], index) => (index ? path.lineTo(x, y) : path.moveTo(x, y)));
  if (closed) path.closePath();
  return path;
}

/** Add a rectangle with a heading to a path: its centre, half length and half width. */
export function addBox(path, x, y, heading, halfLength, halfWidth) {
  const ahead = [halfLength * Math.cos(heading), halfLength * Math.sin(heading)];
  const left = [-halfWidth * Math.sin(heading), halfWidth * Math.cos(heading)];
  path.moveTo(x + ahead[0] + left[0], y + ahead[1] + left[1]);
  path.lineTo(x - ahead[0] + left[0], y - ahead[1] + left[1]);
  path.lineTo(x - ahead[0] - left[0], y - ahead[1] - left[1]);
  path.lineTo(x + ahead[0] - left[0], y + ahead[1] - left[1]);
  path.closePath();
}

/** Write text with a rim in the colour of what lies behind it, so that it can be read on anything. */
export function rimmed(context, text, x, y, ink, paper, size = 16, align = "left") {
  context.font = `600 ${size}px system-ui, "DejaVu Sans", sans-serif`;
  context.textAlign = align;
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = paper;
  context.strokeText(text, x, y);
  context.fillStyle = ink;
  context.fillText(text, x, y);
}
