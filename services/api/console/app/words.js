/**
 * Words for codes: kinds of steps here; reasons and outcomes as the service explains them.
 */
export const STEPS = {
  "scan.inspect": "Look at the files",
  "frame.render": "Make the pictures",
  "frame.read": "Read the pictures",
  "frame.train": "Train the fields",
  "frame.extract": "Extract the points",
  "scan.identify": "Identify the modes",
};
export const KINDS = Object.keys(STEPS);
export const stepName = (kind) => STEPS[kind] ?? kind;

/** Symbol beside the word, so that colour is never all there is. */
export const SYMBOLS = {
  queued: "◷",
  pending: "◷",
  ready: "◷",
  sent: "◷",
  running: "▶",
  succeeded: "✓",
  failed: "✕",
  canceled: "⊘",
  accepted: "✓",
  doubtful: "?",
  rejected: "✕",
  open: "!",
  acknowledged: "◐",
  closed: "✓",
  notice: "•",
  warning: "▲",
  critical: "◆",
  missed: "✕",
  submitted: "✓",
  waiting: "◷",
  delivered: "✓",
  given_up: "✕",
  off: "○",
  none: "–",
};

const SURROUNDINGS = {
  temperature_c: "temperature",
  humidity_percent: "humidity",
  light_umol_m2_s: "light",
  soil_water_percent: "soil water",
  mass_g: "mass",
};
/** What a column of the surroundings is called within a sentence. */
export const inWords = (column) => SURROUNDINGS[column] ?? column;

let loaded = null;

/** Reasons, outcomes and kinds of messages, fetched once. */
export function words() {
  loaded ??= fetch(new URL("../words.json", import.meta.url)).then((answer) => answer.json());
  return loaded;
}
