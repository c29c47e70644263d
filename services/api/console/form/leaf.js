/**
 * One value: a number, a word, a choice, a tick, or a few numbers in a row.
 */
import { html } from "../app/html.js";
import { pointer } from "./schema.js";

export function Leaf({ schema, value, label, help, path, optional, required, context }) {
  const name = pointer(path);
  const complaint = context.complaints[name];
  const set = (next) => context.onChange(path, next);
  const control = controlOf({ schema, value, optional, required, set, name, complaint });
  const note = [help, complaint ? "" : bounds(schema)].filter(Boolean).join(" ");
  return html`<label data-pointer=${name}>
    ${schema.type === "boolean" ? html`<span class="tick">${control} ${label}</span>` : [label, control]}
    ${note && html`<span class="help">${note}</span>`}
    ${complaint && html`<span class="wrong" id=${`wrong${name}`}>${complaint}</span>`}
  </label>`;
}

function controlOf({ schema, value, optional, required, set, name, complaint }) {
  const shared = {
    name,
    required: required && !optional,
    "aria-invalid": complaint ? "true" : null,
    "aria-describedby": complaint ? `wrong${name}` : null,
  };
  if (schema.const !== undefined) return html`<input ...${shared} value=${schema.const} disabled />`;
  if (schema.enum) {
    return html`<select ...${shared} onChange=${(event) => set(event.target.value || null)}>
      ${optional && html`<option value="" selected=${value == null}>not given</option>`}
      ${schema.enum.map((one) => html`<option value=${one} selected=${one === value}>${one.replaceAll("_", " ")}
        </option>`)}</select>`;
  }
  if (schema.type === "boolean")
    return html`<input type="checkbox" ...${shared} checked=${value === true}
      onChange=${(event) => set(event.target.checked)} />`;
  if (schema.type === "array")
    return html`<input ...${shared} value=${(value ?? []).join(", ")}
      placeholder=${schema.prefixItems ? "x, y, z" : "separated by commas"}
      onChange=${(event) => set(listOf(event.target.value, schema, optional))} />`;
  if (schema.type === "number" || schema.type === "integer") {
    const onInput = (event) =>
      event.target.value !== "" ? set(Number(event.target.value)) : set(optional ? null : undefined);
    return html`<input type="number" ...${shared} value=${value ?? ""} step=${schema.type === "integer" ? 1 : "any"}
      min=${schema.minimum} max=${schema.maximum}
      placeholder=${optional ? "by itself" : ""} onInput=${onInput} />`;
  }
  return html`<input ...${shared} value=${typeof value === "object" && value ? JSON.stringify(value) : (value ?? "")}
    minlength=${schema.minLength} maxlength=${schema.maxLength} pattern=${schema.pattern?.replaceAll("-]", "\\-]")}
    onInput=${(event) => set(event.target.value === "" && optional ? null : event.target.value)} />`;
}

function listOf(text, schema, optional) {
  const parts = text
    .split(",")
    .map((part) => part.trim())
    .filter(Boolean);
  if (!parts.length && optional) return null;
  const isText = schema.items?.type === "string";
  return isText ? parts : parts.map(Number);
}

function bounds({ minimum, maximum, exclusiveMinimum, exclusiveMaximum }) {
  const low =
    minimum !== undefined ? `from ${minimum}` : exclusiveMinimum !== undefined ? `above ${exclusiveMinimum}` : "";
  const high =
    maximum !== undefined
      ? `to ${maximum.toLocaleString()}`
      : exclusiveMaximum !== undefined && exclusiveMaximum < 1e9
        ? `below ${exclusiveMaximum}`
        : "";
  return [low, high].filter(Boolean).join(" ");
}
