/**
 * Filters of a list: what is chosen stands in the address, so that a filtered list can be sent to somebody.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { requery } from "../app/router.js";

const TYPING_MS = 300;
const FIRST_PAGE = { cursor: "", trail: "" };

export function Choice({ label, name, query, options }) {
  return html`<label>${label}
    <select name=${name} value=${query.get(name) ?? ""}
      onChange=${(event) => requery({ [name]: event.target.value, ...FIRST_PAGE })}>
      <option value="">all</option>
      ${options.map((one) => {
        const { value, text } = typeof one === "string" ? { value: one, text: one } : one;
        return html`<option value=${value} selected=${value === query.get(name)}>${text}</option>`;
      })}
    </select>
  </label>`;
}

export function Words({ label, name, query, placeholder = "", pattern }) {
  const [text, setText] = useState(query.get(name) ?? "");
  const timer = useRef(0);
  useEffect(() => () => clearTimeout(timer.current), []);
  const onInput = (event) => {
    const value = event.target.value.trim();
    setText(event.target.value);
    clearTimeout(timer.current);
    if (event.target.checkValidity())
      timer.current = setTimeout(() => requery({ [name]: value, ...FIRST_PAGE }), TYPING_MS);
  };
  return html`<label>${label}
    <input type="search" name=${name} value=${text} placeholder=${placeholder} pattern=${pattern} onInput=${onInput} />
  </label>`;
}
