// The caption of a picture: drive time, speed, gap and what the gateway does, in a strip at the lower left.

const STATES = { stopping: "#ffb454", stopped: "#ffb454", fault: "#ff7b6b", engaged: "#7fd1ae" };

/** Write the caption of a frame at a drive time [s] on a picture. */
export function drawCaption(context, frame, time) {
  const { width, height } = context.canvas;
  const size = Math.max(11, Math.round(Math.min(width, height * 1.78) / 62));
  const parts = [
    [`${time.toFixed(1)} s`, "#ffffff"],
    [frame.ego?.speed == null ? "no pose" : `${(3.6 * Math.abs(frame.ego.speed)).toFixed(0)} km/h`, "#ffffff"],
    ...(frame.gap === null ? [] : [[`gap ${frame.gap.toFixed(frame.gap < 10 ? 1 : 0)} m`, "#ffffff"]]),
    [frame.state, STATES[frame.state] ?? "#c8ccd0"],
  ];
  context.font = `600 ${size}px "DejaVu Sans", Verdana, sans-serif`;
  context.textBaseline = "middle";
  context.textAlign = "left";
  const space = 1.4 * size;
  const widths = parts.map(([text]) => context.measureText(text).width);
  const long = widths.reduce((sum, one) => sum + one + space, space);
  const [left, top, high] = [size, height - 3.1 * size, 2.1 * size];
  context.fillStyle = "rgba(16, 20, 24, 0.66)";
  context.beginPath();
  context.roundRect(left, top, long, high, high / 2);
  context.fill();
  let x = left + space;
  parts.forEach(([text, colour], i) => {
    context.fillStyle = colour;
    context.fillText(text, x, top + high / 2 + 1);
    x += widths[i] + space;
  });
}
