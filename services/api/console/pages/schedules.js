/**
 * Scans that come again: when, of which plant, whether the last was submitted or missed; changed where they stand.
 */
import { Fragment, html, useState } from "../app/html.js";
import { get, patch, post, remove } from "../app/api.js";
import { ago, counted, moment } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { to } from "../app/router.js";
import { useAct } from "../parts/act.js";
import { Confirm } from "../parts/dialog.js";
import { State } from "../parts/marks.js";
import { Pager } from "../parts/pager.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";
import { pick } from "./scans.js";
import { ScheduleFields, changed, said } from "./schedule_fields.js";

const COLUMNS = 5;
const MOST_RUNS = 14;

export default function Schedules({ query }) {
  const asked = { ...pick(query, ["plant", "cursor"]), limit: 50 };
  const state = useLoad((signal) => get("/v1/schedules", asked, signal), [JSON.stringify(asked)]);
  return html`<h1>Schedules</h1>
    <${Loaded} state=${state}>${(page) => html`
      ${
        page.items.length
          ? html`<${Table} items=${page.items} onChange=${state.reload} />`
          : html`<p class="wait">No plant is scanned by itself yet.</p>`
      }<${Pager} next=${page.next_cursor} />`}<//>
    <${NewSchedule} onMade=${state.reload} />`;
}

function Table({ items, onChange }) {
  const [doomed, setDoomed] = useState(null);
  return html`<div class="scroll"><table class="schedules">
      <caption class="hidden-label">${counted(items.length, "schedule")}</caption>
      <thead><tr><th scope="col">Plant</th><th scope="col">When</th><th scope="col">Next</th><th scope="col"
        class="aside">Last</th><th scope="col"><span class="hidden-label">Actions</span></th></tr></thead>
      <tbody>${items.map(
        (one) => html`<${Row} key=${one.id} one=${one} onChange=${onChange} onDelete=${() => setDoomed(one)} />`,
      )}</tbody></table></div>
    <${Confirm} open=${doomed !== null} title="Delete this schedule?"
      text=${`Scans of ${doomed?.plant} are no longer begun by themselves; those that were made stay.`}
      yes="Delete it" danger onClose=${() => setDoomed(null)}
      work=${async () => {
        await remove(`/v1/schedules/${doomed.id}`);
        onChange();
      }} />`;
}

function Row({ one, onChange, onDelete }) {
  const [open, setOpen] = useState(false);
  const act = useAct();
  const pause = () =>
    act.run(async () => {
      await patch(`/v1/schedules/${one.id}`, { enabled: !one.enabled });
      onChange();
    });
  const onKept = () => {
    setOpen(false);
    onChange();
  };
  return html`<${Fragment}><tr data-schedule=${one.id}>
      <td><a href=${to(["plants", one.plant])}>${one.plant}</a></td>
      <td>${one.cron ? html`<code>${one.cron}</code> ${one.time_zone}` : `every ${one.every_hours} h`}</td>
      <td>${one.enabled ? html`<time title=${moment(one.next_due_at)}>${ago(one.next_due_at)}</time>` : "paused"}</td>
      <td class="aside">${one.last ? html`<${Run} run=${one.last} />` : "–"}</td>
      <td><div class="buttons tight"><button aria-expanded=${open} aria-controls=${`edit-${one.id}`}
        aria-label=${`Change the schedule of ${one.plant}`} onClick=${() => setOpen(!open)}>Change</button>
        <button onClick=${pause} disabled=${act.busy}>${one.enabled ? "Pause" : "Go on"}</button>
        <button class="danger" onClick=${onDelete}>Delete</button></div><${ProblemBox} problem=${act.problem} /></td>
    </tr>
    ${open && html`<tr class="detail" id=${`edit-${one.id}`}><td colspan=${COLUMNS}><${Edit} one=${one} onKept=${onKept}
      onLeft=${() => setOpen(false)} /></td></tr>`}<//>`;
}

function Run({ run }) {
  const when = html`<time datetime=${run.due_at} title=${moment(run.due_at)}>${ago(run.due_at)}</time>`;
  return html`<${State} of=${run.state} /> ${
    run.scan ? html`<a href=${to(["scans", run.scan])}>${when}</a>` : html`${when} ${run.reason ?? ""}`
  }`;
}

/** The schedule's fields where it stands, and what became of its last times. */
function Edit({ one, onKept, onLeft }) {
  const act = useAct();
  const runs = useLoad((signal) => get(`/v1/schedules/${one.id}/runs`, { limit: MOST_RUNS }, signal), [one.id]);
  const onSubmit = (event) => {
    event.preventDefault();
    act.run(async () => {
      const changes = changed(one, said(event.target));
      if (Object.keys(changes).length) await patch(`/v1/schedules/${one.id}`, changes);
      tell(Object.keys(changes).length ? "The schedule is changed." : "Nothing was changed.");
      onKept();
    });
  };
  return html`<form onSubmit=${onSubmit} aria-label=${`Schedule of ${one.plant}`}>
      <${ScheduleFields} schedule=${one} /><p class="small">Another time counts from now.</p>
      <${ProblemBox} problem=${act.problem} />
      <div class="buttons"><button type="button" onClick=${onLeft}>Leave it</button><button class="main"
        disabled=${act.busy}>Keep the changes</button></div></form>
    <h3>Its last times</h3>
    <${Loaded} state=${runs}>${({ items }) =>
      items.length
        ? html`<ul class="runs">${items.map((run) => html`<li key=${run.due_at}><${Run} run=${run} /></li>`)}</ul>`
        : html`<p class="soft">None has come yet.</p>`}<//>`;
}

function NewSchedule({ onMade }) {
  const act = useAct();
  const onSubmit = (event) => {
    event.preventDefault();
    act.run(async () => {
      const plant = new FormData(event.target).get("plant");
      await post("/v1/schedules", { plant, ...said(event.target) });
      tell("The schedule is made.");
      onMade();
    });
  };
  return html`<details class="card"><summary>New schedule</summary><form onSubmit=${onSubmit}>
    <div class="fields"><label>Plant <input name="plant" required pattern="[A-Za-z0-9][A-Za-z0-9_.\\-]*" /></label></div>
    <${ScheduleFields} /><${ProblemBox} problem=${act.problem} />
    <div class="buttons"><button class="main" disabled=${act.busy}>Make the schedule</button></div></form></details>`;
}
