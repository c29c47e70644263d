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
  const near = neighbourhoods(sensors, radius);
  const result = new Float32Array(points.length);
  for (let k = 0; k < points.length; k += 3) {
    let [weight, x, y, z] = [0, 0, 0, 0];
    for (const s of near(points[k], points[k + 1], points[k + 2])) {
      const far =
        ((points[k] - sensors[s]) ** 2 +
          (points[k + 1] - sensors[s + 1]) ** 2 +
          (points[k + 2] - sensors[s + 2]) ** 2) /
        radius ** 2;
      if (far >= 1) continue;
      const share = (1 - far) ** 2 / (far + 1e-4);
      weight += share;
      x += share * motion[s];
      y += share * motion[s + 1];
      z += share * motion[s + 2];
    }
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

/** `near(x, y, z)`: the sensors in the cell of a point and in those around it; put together once for each cell. */
function neighbourhoods(sensors, radius) {
  const cell = (value, axis) => Math.floor((value - sensors[axis]) / radius);
  const cells = new Map();
  for (let s = 0; s < sensors.length; s += 3) {
    const key = name(cell(sensors[s], 0), cell(sensors[s + 1], 1), cell(sensors[s + 2], 2));
    if (!cells.has(key)) cells.set(key, []);
    cells.get(key).push(s);
  }
  const joined = new Map();
  return function near(x, y, z) {
    const place = [cell(x, 0), cell(y, 1), cell(z, 2)];
    const key = name(...place);
    if (!joined.has(key)) joined.set(key, around(place).flatMap((one) => cells.get(one) ?? []));
    return joined.get(key);
  };
}

const AROUND = [-1, 0, 1];
const around = ([i, j, k]) =>
  AROUND.flatMap((a) => AROUND.flatMap((b) => AROUND.map((c) => name(i + a, j + b, k + c))));

const HALF = 2 ** 16; // cells to either side of the first sensor: three places make one whole number, exactly
const name = (i, j, k) => i + HALF + 2 * HALF * (j + HALF + 2 * HALF * (k + HALF));
