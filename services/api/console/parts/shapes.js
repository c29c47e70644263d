/**
 * Shapes of points beside colours, for uPlot: each draws the points of one series that are in view.
 */
const PATHS = {
  square: (ctx, x, y, r) => ctx.rect(x - r, y - r, 2 * r, 2 * r),
  diamond: (ctx, x, y, r) =>
    polygon(ctx, [
      [x, y - 1.3 * r],
      [x + 1.3 * r, y],
      [x, y + 1.3 * r],
      [x - 1.3 * r, y],
    ]),
  triangle: (ctx, x, y, r) =>
    polygon(ctx, [
      [x, y - 1.3 * r],
      [x + 1.2 * r, y + r],
      [x - 1.2 * r, y + r],
    ]),
  disc: (ctx, x, y, r) => ctx.moveTo(x + r, y) ?? ctx.arc(x, y, r, 0, 7),
};
PATHS.ring = PATHS.disc;
PATHS.cross = (ctx, x, y, r) => {
  ctx.moveTo(x - r, y - r);
  ctx.lineTo(x + r, y + r);
  ctx.moveTo(x - r, y + r);
  ctx.lineTo(x + r, y - r);
};
const OPEN = ["ring", "cross"];

function polygon(ctx, corners) {
  corners.forEach(([x, y], k) => (k ? ctx.lineTo(x, y) : ctx.moveTo(x, y)));
  ctx.closePath();
}

/** For each shape what uPlot calls to draw a series' points. */
export const DRAWERS = Object.fromEntries(
  Object.keys(PATHS).map((shape) => [shape, (u, index, from, to) => draw(u, index, from, to, shape)]),
);

function draw(u, index, from, to, shape) {
  const { ctx, data, series } = u;
  const radius = (series[index].points.size / 2) * devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  for (let k = from; k <= to; k++) {
    if (data[index][k] == null) continue;
    PATHS[shape](ctx, u.valToPos(data[0][k], "x", true), u.valToPos(data[index][k], "y", true), radius);
  }
  ctx.fillStyle = ctx.strokeStyle = series[index].points.stroke();
  ctx.lineWidth = 1.4 * devicePixelRatio;
  if (OPEN.includes(shape)) ctx.stroke();
  else ctx.fill();
  ctx.restore();
  return false;
}
