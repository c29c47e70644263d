/**
 * Who is told what happens: addresses and e-mail, each with a log of what it was told.
 */
import { html, useState } from "../app/html.js";
import { get, post } from "../app/api.js";
import { counted, day } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { go, to } from "../app/router.js";
import { useAct } from "../parts/act.js";
import { State } from "../parts/marks.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { Secret } from "../parts/secret.js";
import { WebhookFields, said } from "./webhook_fields.js";

export default function Webhooks() {
  const state = useLoad((signal) => get("/v1/webhooks", {}, signal), []);
  return html`<h1>Webhooks</h1>
    <p class="soft">Addresses that are told of scans and alarms, by signed messages or by e-mail.</p>
    <${Loaded} state=${state}>${({ items }) =>
      items.length ? html`<${Table} hooks=${items} />` : html`<p class="wait">Nobody is told anything yet.</p>`}<//>
    <${NewWebhook} />`;
}

function Table({ hooks }) {
  return html`<div class="scroll"><table class="webhooks">
    <caption class="hidden-label">${counted(hooks.length, "webhook")}</caption>
    <thead><tr><th scope="col">Address</th><th scope="col">Is told</th><th scope="col">State</th><th
      scope="col" class="aside">Since</th></tr></thead>
    <tbody>${hooks.map(
      (hook) => html`<tr key=${hook.id} data-webhook=${hook.id}>
      <td><a class="address" href=${to(["webhooks", hook.id])}>${hook.url}</a>${
        hook.description && html`<br /><span class="small">${hook.description}</span>`
      }</td>
      <td>${hook.types.length ? hook.types.join(", ") : "everything"}</td>
      <td><${State} of=${hook.enabled ? "succeeded" : "off"} word=${hook.enabled ? "on" : "off"} /></td>
      <td class="aside">${day(hook.created_at)}</td></tr>`,
    )}</tbody></table></div>`;
}

function NewWebhook() {
  const act = useAct();
  const [made, setMade] = useState(null);
  const onSubmit = (event) => {
    event.preventDefault();
    act.run(async () => setMade(await post("/v1/webhooks", said(event.target))));
  };
  return html`<details class="card"><summary>Tell another address</summary><form onSubmit=${onSubmit}>
    <${WebhookFields} />
    <${ProblemBox} problem=${act.problem} />
    <div class="buttons"><button class="main" disabled=${act.busy}>Tell this address</button></div></form></details>
    <${Secret} secret=${made?.secret ?? ""} what="What its messages are signed with"
      onClose=${() => go(to(["webhooks", made.id]))} />`;
}
