/**
 * What a webhook is: its address, what it is told, a word about it. The same fields make and change one.
 */
import { html, useEffect, useState } from "../app/html.js";
import { words } from "../app/words.js";

export function WebhookFields({ hook }) {
  const [known, setKnown] = useState([]);
  useEffect(() => {
    words().then(
      (found) => setKnown(Object.entries(found.messages)),
      () => {},
    );
  }, []);
  const others = (hook?.types ?? []).filter((type) => !known.some(([name]) => name === type));
  return html`<div class="fields">
    <label>Address <input name="url" required maxlength="2000" placeholder="https://… or mailto:…" defaultValue=${hook?.url ?? ""}
      /></label>
    <label>What it is for <input name="description" maxlength="255" defaultValue=${hook?.description ?? ""} /></label></div>
    <fieldset><legend>Is told of (none chosen: of everything)</legend><div class="ticks">
      ${[...known, ...others.map((type) => [type, ""])].map(
        ([type, what]) => html`<label class="row" key=${type}><input type="checkbox" name="types" value=${type}
          defaultChecked=${hook?.types.includes(type)} /><span><code>${type}</code> <span class="small">${what}</span></span></label>`,
      )}</div></fieldset>`;
}

/** What the fields of a form say, as the service wants it. */
export function said(form) {
  const found = new FormData(form);
  return { url: found.get("url").trim(), description: found.get("description"), types: found.getAll("types") };
}
