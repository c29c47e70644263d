/**
 * Where the service asks for an API key: one field, and what happens with it.
 */
import { html, useRef } from "../app/html.js";
import { apiKey } from "../app/api.js";
import { Dialog } from "./dialog.js";

export function KeyDialog({ open, onKey, onClose }) {
  const field = useRef(null);
  const submit = (event) => {
    event.preventDefault();
    onKey(field.current.value.trim());
  };
  return html`<${Dialog} open=${open} title="API key" onClose=${onClose}>
    <p>This service asks for a key. It is kept until this tab is closed, and sent to this service alone.</p>
    <form onSubmit=${submit}>
      <label>Key <input ref=${field} type="password" autocomplete="off" placeholder="nm_…" name="key" /></label>
      <p class="small">An operator makes one with <code>nerfmodal keys create</code>.</p>
      <div class="buttons">
        ${apiKey() && html`<button type="button" onClick=${() => onKey("")}>Forget the key</button>`}
        <button class="main">Use this key</button>
      </div>
    </form>
  <//>`;
}
