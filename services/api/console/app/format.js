/**
 * Numbers, times and sizes in words, in the reader's own language where that is a matter of habit.
 */
const DAY = new Intl.DateTimeFormat(undefined, { dateStyle: "medium" });
const MOMENT = new Intl.DateTimeFormat(undefined, { dateStyle: "medium", timeStyle: "short" });
const CLOCK = new Intl.DateTimeFormat(undefined, { timeStyle: "medium" });
const AGO = new Intl.RelativeTimeFormat(undefined, { numeric: "auto" });
const UNITS = [
  ["year", 31_557_600],
  ["month", 2_629_800],
  ["day", 86_400],
  ["hour", 3600],
  ["minute", 60],
  ["second", 1],
];
export const NONE = "–";

export const moment = (text) => (text ? MOMENT.format(new Date(text)) : NONE);
export const day = (text) => (text ? DAY.format(new Date(text)) : NONE);
export const clock = (text) => (text ? CLOCK.format(new Date(text)) : NONE);

/** "2 hours ago". */
export function ago(text, now = Date.now()) {
  if (!text) return NONE;
  const seconds = (new Date(text) - now) / 1000;
  const [unit, length] = UNITS.find(([, length]) => Math.abs(seconds) >= length) ?? UNITS.at(-1);
  return AGO.format(Math.round(seconds / length), unit);
}

/** "1 h 04 min", "3.2 s". */
export function duration(seconds) {
  if (seconds == null || !Number.isFinite(seconds)) return NONE;
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return `${minutes} min`;
  const hours = Math.floor(minutes / 60);
  const rest = minutes % 60 ? ` ${String(minutes % 60).padStart(2, "0")} min` : "";
  return hours < 48 ? `${hours} h${rest}` : `${Math.round(hours / 24)} days`;
}

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB", "TB"];
  const step = Math.min(units.length - 1, Math.floor(Math.log10(Math.max(1, count)) / 3));
  const value = count / 1000 ** step;
  return `${step && value < 100 ? value.toFixed(1) : Math.round(value)} ${units[step]}`;
}

/** "99.2 % sure"; never all of it. */
export const sureness = (share) => (share > 0.999 ? "more than 99.9 % sure" : `${percent(share, 1)} sure`);

export const percent = (share, digits = 0) => (share == null ? NONE : `${(100 * share).toFixed(digits)} %`);

/** So many significant digits, without an exponent where it can be avoided. */
export function number(value, digits = 4) {
  if (value == null || !Number.isFinite(value)) return NONE;
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return value.toExponential(digits - 1);
  return String(Number(value.toPrecision(digits)));
}

/** So many significant digits, noughts at the end among them: columns of like numbers stand in line. */
export const digits = (value, count = 4) => (value == null ? NONE : value.toPrecision(count));

/** A value to the digit that its standard deviation leaves sure: "2.0005 ± 0.0008". */
export function measured(value, std, scale = 1) {
  if (value == null) return NONE;
  if (std == null || !(std > 0)) return number(value * scale, 4);
  const spread = std * scale;
  const digits = Math.max(0, Math.min(10, 1 - Math.floor(Math.log10(spread))));
  return `${(value * scale).toFixed(digits)} ± ${spread.toFixed(digits)}`;
}

/** "3 modes", "1 mode". */
export const counted = (count, one, many = `${one}s`) => `${count.toLocaleString()} ${count === 1 ? one : many}`;
