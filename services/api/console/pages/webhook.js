/**
 * One webhook: what it is and what it was told. It is tested, changed, switched off, given a new secret, deleted.
 */
import { html, useState } from "../app/html.js";
import { get, patch, post, remove } from "../app/api.js";
import { day } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { go, to } from "../app/router.js";
import { useAct } from "../parts/act.js";
import { Confirm, Dialog } from "../parts/dialog.js";
import { State } from "../parts/marks.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { Secret } from "../parts/secret.js";
import { tell } from "../parts/told.js";
import { WebhookFields, said } from "./webhook_fields.js";
import { Deliveries } from "./webhook_log.js";

export default function Webhook({ id, query }) {
  const state = useLoad((signal) => get(`/v1/webhooks/${id}`, {}, signal), [id]);
  const [tests, setTests] = useState(0);
  return html`<p class="small"><a href=${to(["webhooks"])}>← All webhooks</a></p>
    <${Loaded} state=${state}>${(hook) => html`
      <div class="head"><h1>${hook.url}</h1><${State} of=${hook.enabled ? "succeeded" : "off"}
        word=${hook.enabled ? "on" : "off"} /></div>
      <dl class="facts">
        ${hook.description && html`<dt>What it is for</dt><dd>${hook.description}</dd>`}
        <dt>Is told of</dt><dd>${hook.types.length ? hook.types.join(", ") : "everything"}</dd>
        <dt>Since</dt><dd>${day(hook.created_at)}</dd>
      </dl>
      <${Actions} hook=${hook} onChange=${state.reload} onTest=${() => setTests((old) => old + 1)} />
      <h2>What it was told</h2>
      <${Deliveries} hook=${hook} query=${query} again=${tests} />`}<//>`;
}

function Actions({ hook, onChange, onTest }) {
  const act = useAct();
  const [open, setOpen] = useState("");
  const [secret, setSecret] = useState("");
  const close = () => setOpen("");
  const path = `/v1/webhooks/${hook.id}`;
  const test = () =>
    act.run(async () => {
      await post(`${path}/test`);
      tell("A test message is on its way.");
      onTest();
    });
  const turn = () =>
    act.run(async () => {
      await patch(path, { enabled: !hook.enabled });
      tell(hook.enabled ? "It is switched off: it is told nothing more." : "It is switched on again.");
      onChange();
    });
  return html`<div class="buttons">
      <button onClick=${test} disabled=${act.busy || !hook.enabled}>Send a test</button>
      <button onClick=${turn} disabled=${act.busy}>${hook.enabled ? "Switch off" : "Switch on"}</button>
      <button onClick=${() => setOpen("change")}>Change …</button>
      <button onClick=${() => setOpen("secret")}>New secret …</button>
      <button class="danger" onClick=${() => setOpen("delete")}>Delete …</button></div>
    <${ProblemBox} problem=${act.problem} />
    <${Change} hook=${hook} open=${open === "change"} onClose=${close} onChange=${onChange} />
    <${Confirm} open=${open === "secret"} title="A new secret?" yes="Make a new secret" onClose=${close}
      text="For a day messages carry the signatures of both, so that the receiver can be changed meanwhile."
      work=${async () => setSecret((await post(`${path}/rotate-secret`, {})).secret)} />
    <${Secret} secret=${secret} what="What messages are signed with from now on" onClose=${() => setSecret("")} />
    <${Confirm} open=${open === "delete"} title="Delete this webhook?" yes="Delete it" danger onClose=${close}
      text="It is told nothing more, and what it was told is forgotten. To keep the log, switch it off instead."
      work=${async () => {
        await remove(path);
        tell("The webhook is deleted.");
        go(to(["webhooks"]));
      }} />`;
}

function Change({ hook, open, onClose, onChange }) {
  const act = useAct();
  const onSubmit = (event) => {
    event.preventDefault();
    act.run(async () => {
      await patch(`/v1/webhooks/${hook.id}`, said(event.target));
      onClose();
      tell("The webhook is changed.");
      onChange();
    });
  };
  return html`<${Dialog} open=${open} title="Change this webhook" onClose=${onClose} wide>
    <form onSubmit=${onSubmit}><${WebhookFields} hook=${hook} /><${ProblemBox} problem=${act.problem} />
      <div class="buttons"><button type="button" onClick=${onClose}>No, go back</button><button class="main"
        disabled=${act.busy}>Keep the changes</button></div></form><//>`;
}
