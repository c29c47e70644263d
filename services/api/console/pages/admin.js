/**
 * The service itself: version, workers and API keys.
 */
import { html, useState } from "../app/html.js";
import { get, post, remove } from "../app/api.js";
import { ago, day } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { Confirm } from "../parts/dialog.js";
import { State } from "../parts/marks.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { Secret } from "../parts/secret.js";

export default function Admin() {
  const info = useLoad((signal) => get("/v1/info", {}, signal), []);
  return html`<h1>Service</h1>
    <${Loaded} state=${info}>${(
      one,
    ) => html`<dl class="facts"><dt>Version</dt><dd>${one.version}</dd><dt>Database</dt><dd>${one.database}</dd>
      <dt>Broker</dt><dd>${one.broker}</dd>
      <dt>Workers</dt><dd>${one.workers.length ? one.workers.map((worker) => html`<div>
        ${worker.host}: ${worker.slots} slots (${worker.queues.join(", ")})</div>`) : "none is alive: no step begins"}
        </dd></dl>`}<//>
    <p><a href="/docs">The API's own page</a></p>
    <${Keys} />`;
}

function Keys() {
  const state = useLoad((signal) => get("/v1/keys", {}, signal), []);
  const [secret, setSecret] = useState("");
  const [doomed, setDoomed] = useState(null);
  const [problem, setProblem] = useState(null);
  const make = async (event) => {
    event.preventDefault();
    const form = new FormData(event.target);
    try {
      const made = await post("/v1/keys", { name: form.get("name"), scopes: form.getAll("scopes") });
      setSecret(made.secret);
      setProblem(null);
      state.reload();
    } catch (error) {
      setProblem(error);
    }
  };
  return html`<h2>API keys</h2><${Loaded} state=${state}>${({ items }) => items.length === 0
    ? html`<p class="wait">There are no keys: only callers on this machine are let in.</p>`
    : html`<div class="scroll"><table>
      <thead><tr><th scope="col">Name</th><th scope="col">May</th><th scope="col">Made</th><th scope="col">Used</th><th
        scope="col">State</th><th></th></tr></thead>
      <tbody>${items.map(
        (
          key,
        ) => html`<tr key=${key.id}><td>${key.name}</td><td>${key.scopes.join(", ")}</td><td>${day(key.created_at)}</td>
          <td>${key.last_used_at ? ago(key.last_used_at) : "never"}</td>
        <td><${State} of=${key.revoked_at ? "off" : "succeeded"} word=${key.revoked_at ? "revoked" : "alive"} /></td>
        <td>${!key.revoked_at && html`<button class="danger" onClick=${() => setDoomed(key)}>Revoke</button>`}</td>
          </tr>`,
      )}</tbody></table></div>`}<//>
    <form class="filters" onSubmit=${make}><label>Name <input name="name" required maxlength="64" /></label>
      ${["read", "submit", "admin"].map((scope) => html`<label class="row"><span>${scope}</span><input type="checkbox"
        name="scopes" value=${scope} checked=${scope !== "admin"} /></label>`)}<button>Make a key</button></form>
    <${ProblemBox} problem=${problem} />
    <${Secret} secret=${secret} what="The key" onClose=${() => setSecret("")} />
    <${Confirm} open=${doomed !== null} title="Revoke this key?" text=${`From now on "${doomed?.name}" opens nothing.`}
      yes="Revoke it" danger onClose=${() => setDoomed(null)}
      work=${async () => {
        await remove(`/v1/keys/${doomed.id}`);
        state.reload();
      }} />`;
}
