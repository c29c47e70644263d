/**
 * A mode's shape (shapes/ORGAN_K.npz) as motion in space at its sensors.
 */
import { send } from "../app/api.js";
import { fileAddress } from "../pages/scan_files.js";
import { readNpz } from "./npz.js";

/** {positions, motion}: Float32Arrays of 3 per sensor; metres, and metres for a coordinate of 1. */
export async function fetchShape(scan, key, signal) {
  const arrays = await readNpz(fileAddress(scan, key), (path, options) => send(path, { ...options, signal }));
  return { positions: Float32Array.from(arrays.positions.values), motion: motionOf(arrays) };
}

/** Components along `directions` summed up; a structure's shape has x, y and z already. */
export function motionOf({ shape, directions }) {
  if (!directions) return Float32Array.from(shape.values);
  const axes = directions.shape[0];
  const sensors = shape.values.length / axes;
  const motion = new Float32Array(3 * sensors);
  for (let s = 0; s < sensors; s++)
    for (let a = 0; a < axes; a++)
      for (let x = 0; x < 3; x++) motion[3 * s + x] += shape.values[s * axes + a] * directions.values[3 * a + x];
  return motion;
}
