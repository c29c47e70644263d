/**
 * A form out of a JSON Schema: one control for each key, groups that open, complaints at the field they are about.
 */
import { html } from "../app/html.js";
import { alternatives, fresh, labelOf, pointer, resolve, whichOf } from "./schema.js";
import { Leaf } from "./leaf.js";

const MOST_ITEMS_OPEN = 3;

/** `value` of `schema`; `onChange(path, value)`; `complaints` by JSON pointer. `hidden` names pointers left out. */
export function Form({ schema, value, onChange, complaints = {}, hidden = [] }) {
  const context = { root: schema, onChange, complaints, hidden };
  return html`<div class="fields">${keysOf(schema, value, [], context, schema.required)}</div>`;
}

function keysOf(schema, value, path, context, required = []) {
  return Object.entries(schema.properties ?? {})
    .filter(([name, one]) => one.const === undefined && !context.hidden.includes(pointer([...path, name])))
    .map(
      ([
        name,
        one,
      ]) => html`<${Field} key=${name} name=${name} schema=${one} value=${value?.[name]} path=${[...path, name]}
      required=${required.includes(name)} context=${context} />`,
    );
}

function Field({ name, schema, value, path, required, context }) {
  const whole = resolve(schema, context.root);
  const { options, optional } = alternatives(whole, context.root);
  const present = value === undefined && whole.default !== undefined ? whole.default : value;
  const label = typeof name === "number" ? `${name + 1}` : labelOf(name);
  const help = (whole.description ?? "").replaceAll("`", "");
  const props = { label, help, path, required, context, optional };
  if (options.length > 1) return html`<${Choice} ...${props} options=${options} value=${present} />`;
  return html`<${One} ...${props} schema=${{ ...options[0] }} value=${present} />`;
}

/** A value of one schema, which may be left out. */
function One({ schema, value, label, help, path, required, context, optional }) {
  const isGroup = schema.type === "object" || (schema.type === "array" && !isTuple(schema));
  if (!isGroup)
    return html`<${Leaf} schema=${schema} value=${value} label=${label} help=${help} path=${path} optional=${optional}
      required=${required} context=${context} />`;
  if (value === null || value === undefined) {
    const add = () => context.onChange(path, fresh({ ...schema, default: undefined }, context.root));
    return html`<fieldset><legend>${label}</legend><span class="small">not given </span><button type="button"
      onClick=${add}>Give ${label.toLowerCase()}</button></fieldset>`;
  }
  const forget =
    optional &&
    html`<button type="button" class="plain" onClick=${() => context.onChange(path, null)}>leave out</button>`;
  const body =
    schema.type === "object"
      ? html`<div class="fields">${keysOf(schema, value, path, context, schema.required)}</div>`
      : html`<${Items} schema=${schema} value=${value} label=${label} path=${path} context=${context} />`;
  return html`<${Group} label=${label} help=${help} path=${path} context=${context}
    count=${Array.isArray(value) ? value.length : null}>${forget}${body}<//>`;
}

const isTuple = (schema) => Boolean(schema.prefixItems) || ["string", "number", "integer"].includes(schema.items?.type);

function Group({ label, help, path, context, count, children }) {
  const here = pointer(path);
  const wrong = Object.keys(context.complaints).some((one) => one === here || one.startsWith(`${here}/`));
  const open =
    wrong ||
    here === "/source" ||
    (path.length === 3 && Number.isInteger(path.at(-1)) && path.at(-1) < MOST_ITEMS_OPEN);
  return html`<details open=${open}><summary>${label}${count !== null ? ` (${count})` : ""} <span class="small">${help}
    </span></summary>
    <${Wrong} of=${context.complaints[here]} />${children}</details>`;
}

function Items({ schema, value, label, path, context }) {
  const items = resolve(schema.items, context.root);
  const one = label.toLowerCase().replace(/s$/, "");
  return html`${value.map(
    (item, k) => html`<fieldset key=${k}><legend>${item?.name ?? item?.organ ?? `${one} ${k + 1}`}</legend>
      <div class="fields">${items.type === "object" ? keysOf(items, item, [...path, k], context, items.required) : html`<${Field}
        name=${k} schema=${items} value=${item} path=${[...path, k]} required context=${context} />`}</div>
      <button type="button" onClick=${() => context.onChange([...path, k], undefined)}>Remove</button>
      <button type="button" onClick=${() => context.onChange(path, [...value.slice(0, k + 1), structuredClone(item), ...value.slice(k + 1)])}>Copy</button>
    </fieldset>`,
  )}
    <button type="button" onClick=${() => context.onChange([...path, value.length], fresh({ ...items, default: undefined }, context.root))}>Add to ${label.toLowerCase()}
      </button>`;
}

/** One of several schemas: a list to choose from, then the chosen one. */
function Choice({ options, value, label, help, path, required, context, optional }) {
  const none = value === null || value === undefined;
  const chosen = none ? -1 : whichOf(options, value);
  const choose = (event) => {
    const index = Number(event.target.value);
    context.onChange(path, index < 0 ? null : fresh({ ...options[index], default: undefined }, context.root));
  };
  const option = options[chosen];
  const isPlain = option && (option.const !== undefined || option.enum);
  return html`<fieldset><legend>${label}</legend>${help && html`<p class="small">${help}</p>`}
    <label><span class="hidden-label">Kind of ${label}</span><select name=${pointer(path)} onChange=${choose}
      required=${required}>
      ${(optional || none) && html`<option value="-1" selected=${none}>not given</option>`}
      ${options.map((one, k) => html`<option value=${k} selected=${k === chosen}>${nameOf(one)}</option>`)}
    </select></label>
    <${Wrong} of=${context.complaints[pointer(path)]} />
    ${option && !isPlain && hasKeys(option) && html`<${One} schema=${{ ...option, description: undefined }}
      value=${value} label=${nameOf(option)} help=${(option.description ?? "").replaceAll("`", "")} path=${path}
      context=${context} />`}
  </fieldset>`;
}

/** Whether there is more to fill in than which of the alternatives it is. */
const hasKeys = (option) =>
  option.type !== "object" || Object.values(option.properties ?? {}).some((one) => one.const === undefined);

function nameOf(option) {
  const kind = option.const ?? option.properties?.kind?.const;
  return (kind ?? { array: "a list", object: option.title }[option.type] ?? option.title ?? option.type).replaceAll(
    "_",
    " ",
  );
}

export function Wrong({ of }) {
  return of ? html`<span class="wrong" role="alert">${of}</span>` : null;
}
