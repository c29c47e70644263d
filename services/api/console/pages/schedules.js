/**
 * Scans that come again: when, of which plant, whether the last was submitted or missed.
 */
import { html, useState } from "../app/html.js";
import { get, patch, post, remove } from "../app/api.js";
import { ago, counted, moment } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { to } from "../app/router.js";
import { Confirm } from "../parts/dialog.js";
import { State } from "../parts/marks.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";

export default function Schedules() {
  const state = useLoad((signal) => get("/v1/schedules", { limit: 200 }, signal), []);
  const [doomed, setDoomed] = useState(null);
  const pause = async (one) => {
    await patch(`/v1/schedules/${one.id}`, { enabled: !one.enabled });
    state.reload();
  };
  return html`<h1>Schedules</h1>
    <${Loaded} state=${state}>${(page) => html`
      ${page.items.length === 0 && html`<p class="wait">No plant is scanned by itself yet.</p>`}
      ${
        page.items.length > 0 &&
        html`<div class="scroll"><table>
        <caption class="hidden-label">${counted(page.items.length, "schedule")}</caption>
        <thead><tr><th scope="col">Plant</th><th scope="col">When</th><th scope="col">Next</th><th scope="col">Last</th>
          <th scope="col"></th></tr></thead>
        <tbody>${page.items.map(
          (one) => html`<tr key=${one.id}>
          <td><a href=${to(["plants", one.plant])}>${one.plant}</a></td>
          <td>${one.cron ? html`<code>${one.cron}</code> ${one.time_zone}` : `every ${one.every_hours} h`}</td>
          <td>${one.enabled ? html`<time title=${moment(one.next_due_at)}>${ago(one.next_due_at)}</time>` : "paused"}
            </td>
          <td>${one.last ? html`<${State} of=${one.last.state} /> ${one.last.scan ? html`<a
            href=${to(["scans", one.last.scan])}>${ago(one.last.due_at)}
            </a>` : `${ago(one.last.due_at)} ${one.last.reason ?? ""}`}` : "–"}</td>
          <td><button onClick=${() => pause(one)}>${one.enabled ? "Pause" : "Go on"}</button> <button class="danger"
            onClick=${() => setDoomed(one)}>Delete</button></td>
        </tr>`,
        )}</tbody></table></div>`
      }`}<//>
    <${NewSchedule} onMade=${state.reload} />
    <${Confirm} open=${doomed !== null} title="Delete this schedule?"
      text=${`Scans of ${doomed?.plant} are no longer begun by themselves; those that were made stay.`}
      yes="Delete it" danger
      work=${async () => {
        await remove(`/v1/schedules/${doomed.id}`);
        state.reload();
      }} onClose=${() => setDoomed(null)} />`;
}

function NewSchedule({ onMade }) {
  const [problem, setProblem] = useState(null);
  const onSubmit = async (event) => {
    event.preventDefault();
    const said = Object.fromEntries(new FormData(event.target));
    try {
      const when = said.cron
        ? { cron: said.cron, time_zone: said.time_zone || "UTC" }
        : { every_hours: Number(said.every_hours) };
      await post("/v1/schedules", { plant: said.plant, ...when, spec: JSON.parse(said.spec) });
      setProblem(null);
      tell("The schedule is made.");
      onMade();
    } catch (error) {
      setProblem(error);
    }
  };
  return html`<details class="card"><summary>New schedule</summary><form onSubmit=${onSubmit}>
    <div class="fields"><label>Plant <input name="plant" required pattern="[A-Za-z0-9][A-Za-z0-9_.\\-]*" /></label>
      <label>Every so many hours <input type="number" name="every_hours" min="0.1" step="any" value="12" /></label>
      <label>or as cron writes it <input name="cron" placeholder="0 6,18 * * *" /></label><label>Time zone <input
        name="time_zone" placeholder="UTC" /></label></div>
    <label>Specification as JSON, without the plant; <code>{plant}</code>, <code>{date}</code> and <code>{time}
      </code> stand for themselves in a path
      <textarea class="spec" name="spec" required
        spellcheck="false">{"source": {"kind": "capture", "path": "incoming/{plant}/{date}"}}</textarea></label>
    <${ProblemBox} problem=${problem} /><div class="buttons"><button class="main">Make the schedule</button></div>
      </form></details>`;
}
