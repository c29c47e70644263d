/**
 * What a simulation imposed, beside what was found: truth.npz, which the service shows but never computes with.
 */
import { send } from "../app/api.js";
import { readNpz } from "../space/npz.js";
import { fileAddress } from "./scan_files.js";

const FARTHEST = 0.25; // of the true frequency: beyond it two lines are not the same mode

/** [{organ, name, frequency, damping}] or null where nothing was imposed. */
export async function fetchTruth(scan, signal) {
  const fetchPart = (path, options) => send(path, { ...options, signal });
  let found;
  try {
    found = await readNpz(fileAddress(scan.id, "truth.npz"), fetchPart, ["names", "values"]);
  } catch (problem) {
    if (problem.status === 404) return null;
    throw problem;
  }
  const { names, values } = found;
  const width = values.shape[1];
  return Array.from({ length: names.shape[0] }, (_, k) => ({
    organ: names.values[2 * k],
    name: names.values[2 * k + 1],
    frequency: values.values[width * k],
    damping: values.values[width * k + 1],
  }));
}

/** True mode by "organ k" of the found one, each used once, the nearest pairs first; and what was not found. */
export function pairs(truth, organs) {
  const found = organs.flatMap((organ) =>
    organ.modes.map((mode) => ({ key: `${organ.name} ${mode.mode}`, organ: organ.name, mode })),
  );
  const near = truth
    .flatMap((one) =>
      found
        .filter((mine) => mine.organ === one.organ)
        .map((mine) => ({ one, mine, far: Math.abs(mine.mode.natural_frequency_hz / one.frequency - 1) })),
    )
    .filter(({ far }) => far < FARTHEST)
    .sort((a, b) => rank(a.mine) - rank(b.mine) || a.far - b.far);
  const [matched, used] = [new Map(), new Set()];
  for (const { one, mine } of near) {
    if (used.has(one) || matched.has(mine.key)) continue;
    matched.set(mine.key, one);
    used.add(one);
  }
  return { matched, missed: truth.filter((one) => !used.has(one)) };
}

const rank = (mine) => (mine.mode.verdict === "rejected" ? 1 : 0);
