/**
 * A mode is known at sensors, a cloud has other points: each point moves like the sensors around it.
 *
 * Weights fall to zero at a radius of a few sensor spacings (Shepard with compact support), so that points without a
 * sensor near them, those of other organs and of the pot, stay where they are.
 */
const SPACINGS = 3;
const SAMPLE = 200;

/** Motion at points: Float32Array of 3 per point, metres for a coordinate of 1. All arguments are flat arrays. */
export function motionAt(points, sensors, motion) {
  const radius = SPACINGS * spacing(sensors);
  const grid = gridOf(sensors, radius);
  const result = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 3) {
    let [weight, x, y, z] = [0, 0, 0, 0];
    visit(grid, radius, points[k], points[k + 1], points[k + 2], (s) => {
      const far =
        ((points[k] - sensors[s]) ** 2 +
          (points[k + 1] - sensors[s + 1]) ** 2 +
          (points[k + 2] - sensors[s + 2]) ** 2) /
        radius ** 2;
      if (far >= 1) return;
      const share = (1 - far) ** 2 / (far + 1e-4);
      weight += share;
      x += share * motion[s];
      y += share * motion[s + 1];
      z += share * motion[s + 2];
    });
    if (weight > 0) result.set([x / weight, y / weight, z / weight], k);
  }
  return result;
}

/** Median distance of some sensors to their nearest neighbour, metres. */
export function spacing(sensors) {
  const count = sensors.length / 3;
  if (count < 2) return 0.05;
  const step = Math.max(1, Math.floor(count / SAMPLE));
  const nearest = [];
  for (let a = 0; a < count; a += step) {
    let best = Infinity;
    for (let b = 0; b < count; b++) {
      if (a === b) continue;
      const far =
        (sensors[3 * a] - sensors[3 * b]) ** 2 +
        (sensors[3 * a + 1] - sensors[3 * b + 1]) ** 2 +
        (sensors[3 * a + 2] - sensors[3 * b + 2]) ** 2;
      if (far > 0 && far < best) best = far;
    }
    nearest.push(Math.sqrt(best));
  }
  return nearest.sort((a, b) => a - b)[nearest.length >> 1];
}

const cell = (value, radius) => Math.floor(value / radius);
const name = (x, y, z) => (x * 73856093) ^ (y * 19349663) ^ (z * 83492791);

function gridOf(sensors, radius) {
  const grid = new Map();
  for (let s = 0; s < sensors.length; s += 3) {
    const key = name(cell(sensors[s], radius), cell(sensors[s + 1], radius), cell(sensors[s + 2], radius));
    if (!grid.has(key)) grid.set(key, []);
    grid.get(key).push(s);
  }
  return grid;
}

function visit(grid, radius, x, y, z, work) {
  const [cx, cy, cz] = [cell(x, radius), cell(y, radius), cell(z, radius)];
  const seen = new Set();
  for (let i = -1; i <= 1; i++)
    for (let j = -1; j <= 1; j++)
      for (let k = -1; k <= 1; k++) {
        const key = name(cx + i, cy + j, cz + k);
        if (seen.has(key)) continue; // two cells may share a name
        seen.add(key);
        grid.get(key)?.forEach(work);
      }
}
