/**
 * JSON Schema as the service writes it: references followed, alternatives told apart, a value to begin with.
 */

/** The schema behind `$ref`, with what stands beside it (default, title, description). */
export function resolve(schema, root) {
  if (!schema.$ref) return schema;
  const { $ref, ...beside } = schema;
  return { ...root.$defs[$ref.split("/").at(-1)], ...beside };
}

/** The alternatives of a schema, null apart: {options, optional}. One option is no choice. */
export function alternatives(schema, root) {
  const all = (schema.oneOf ?? schema.anyOf ?? [schema]).map((one) => resolve(one, root));
  const options = all.filter((one) => one.type !== "null");
  return { options, optional: options.length < all.length };
}

/** Which alternative a value is an instance of, by its discriminator or its type; 0 where none fits. */
export function whichOf(options, value) {
  const found = options.findIndex((one) => fits(one, value));
  return Math.max(0, found);
}

function fits(option, value) {
  if (option.const !== undefined) return option.const === value;
  if (option.enum) return option.enum.includes(value);
  if (option.type === "array") return Array.isArray(value);
  if (option.type === "object") {
    const kind = option.properties?.kind?.const;
    return (
      value !== null &&
      typeof value === "object" &&
      !Array.isArray(value) &&
      (kind === undefined || value.kind === kind)
    );
  }
  if (option.type === "integer" || option.type === "number") return typeof value === "number";
  return typeof value === option.type;
}

/** What a new value of the schema is: its default, or the least that has every required key. */
export function fresh(schema, root) {
  const whole = resolve(schema, root);
  if (whole.default !== undefined) return structuredClone(whole.default);
  if (whole.const !== undefined) return whole.const;
  if (whole.enum) return whole.enum[0];
  const { options } = alternatives(whole, root);
  if (options[0] !== whole && options.length) return fresh(options[0], root);
  if (whole.type === "object") return freshObject(whole, root);
  if (whole.type === "array") return (whole.prefixItems ?? []).map((one) => fresh(one, root));
  if (whole.type === "boolean") return false;
  if (whole.type === "string") return "";
  return whole.minimum ?? (whole.exclusiveMinimum !== undefined ? whole.exclusiveMinimum + 1 : 0);
}

function freshObject(schema, root) {
  const names = Object.keys(schema.properties ?? {}).filter((name) => schema.required?.includes(name));
  return Object.fromEntries(names.map((name) => [name, fresh(schema.properties[name], root)]));
}

/** A copy of `tree` with the value at a path of keys replaced; undefined removes it. */
export function changed(tree, path, value) {
  if (!path.length) return value;
  const [key, ...rest] = path;
  const copy = Array.isArray(tree) ? [...tree] : { ...tree };
  const next = changed(copy[key], rest, value);
  if (next === undefined && Array.isArray(copy)) copy.splice(key, 1);
  else if (next === undefined) delete copy[key];
  else copy[key] = next;
  return copy;
}

/** The merge patch (RFC 7396) that makes `after` of `before`; undefined where they are equal. */
export function mergePatch(before, after) {
  if (!isObject(before) || !isObject(after))
    return JSON.stringify(before) === JSON.stringify(after) ? undefined : after;
  const patch = {};
  for (const key of new Set([...Object.keys(before), ...Object.keys(after)])) {
    const change = key in after ? (key in before ? mergePatch(before[key], after[key]) : after[key]) : null;
    if (change !== undefined) patch[key] = change;
  }
  return Object.keys(patch).length ? patch : undefined;
}

const isObject = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

/** "frame_rate_hz" → "Frame rate (Hz)". */
export function labelOf(name) {
  const units = { hz: "Hz", m: "m", s: "s", deg: "°", px: "px", e: "electrons", ev: "EV", kg: "kg", mm: "mm" };
  const parts = String(name).split("_");
  const unit = parts.length > 1 ? units[parts.at(-1)] : undefined;
  const words = (unit ? parts.slice(0, -1) : parts).join(" ");
  return `${words.charAt(0).toUpperCase()}${words.slice(1)}${unit ? ` (${unit})` : ""}`;
}

/** JSON pointer of a path of keys. */
export const pointer = (path) =>
  path.map((key) => `/${String(key).replaceAll("~", "~0").replaceAll("/", "~1")}`).join("");
