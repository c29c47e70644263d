/**
 * Alarms: what changed, since when, how sure, how long it took to see; acknowledged and closed here.
 */
import { html, useState } from "../app/html.js";
import { get, patch } from "../app/api.js";
import { ago, counted, duration, moment, number, sureness } from "../app/format.js";
import { useCalm, useLoad, useStream } from "../app/hooks.js";
import { to } from "../app/router.js";
import { Confirm } from "../parts/dialog.js";
import { Choice, Words } from "../parts/filters.js";
import { Live, State } from "../parts/marks.js";
import { Pager } from "../parts/pager.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";
import { pick } from "./scans.js";

const KINDS = ["drift", "lost_mode", "scans_failing", "scan_missed"].map((value) => ({
  value,
  text: value.replaceAll("_", " "),
}));
const LOOK_MS = 3000;

export default function Alarms({ query }) {
  const asked = { ...pick(query, ["state", "plant", "kind", "cursor"]), limit: 50 };
  const state = useLoad((signal) => get("/v1/alarms", asked, signal), [JSON.stringify(asked)]);
  const refresh = useCalm(state.reload, LOOK_MS);
  const live = useStream("/v1/events", refresh, refresh);
  return html`
    <div class="head"><h1>Alarms</h1><${Live} state=${live} /></div>
    <div class="filters" role="search">
      <${Choice} label="State" name="state" query=${query} options=${["open", "acknowledged", "closed"]} />
      <${Choice} label="Kind" name="kind" query=${query} options=${KINDS} />
      <${Words} label="Plant" name="plant" query=${query} />
    </div>
    <${Loaded} state=${state}>${(page) => html`
      ${page.items.length === 0 && html`<p class="wait">No alarms here.</p>`}
      ${page.items.map((one) => html`<${AlarmCard} key=${one.id} alarm=${one} onChange=${state.reload} />`)}
      <${Pager} next=${page.next_cursor} />`}<//>`;
}

export function AlarmCard({ alarm, onChange }) {
  const [problem, setProblem] = useState(null);
  const [closing, setClosing] = useState(false);
  const [note, setNote] = useState("");
  const change = async (body, said) => {
    await patch(`/v1/alarms/${alarm.id}`, body);
    tell(said);
    onChange();
  };
  const acknowledge = () =>
    change({ state: "acknowledged", ...(note ? { note } : {}) }, "The alarm is acknowledged.").then(
      () => setProblem(null),
      setProblem,
    );
  return html`<article class=${`card alarm ${alarm.severity} ${alarm.state}`} data-alarm=${alarm.id}>
    <div class="head"><h3><${State} of=${alarm.severity} /> ${alarm.title}</h3><${State} of=${alarm.state} /></div>
    <p>${alarm.what}</p>
    <p class="small"><a href=${to(["plants", alarm.plant])}>${alarm.plant_name || alarm.plant}</a>
      ${alarm.treatment ? ` (${alarm.treatment})` : ""} ·
      ${" "}${[
        alarm.since && `since ${moment(alarm.since)}`,
        alarm.change_percent != null &&
          `${number(alarm.change_percent, 2)} %${alarm.change_percent_std ? ` ± ${number(alarm.change_percent_std, 2)} %` : ""}`,
        alarm.confidence != null && sureness(alarm.confidence),
        alarm.delay_scans != null &&
          `seen after ${counted(alarm.delay_scans, "scan")}${alarm.delay_s ? ` (${duration(alarm.delay_s)})` : ""}`,
        `opened ${ago(alarm.opened_at)}`,
      ]
        .filter(Boolean)
        .join(" · ")}</p>
    ${alarm.note && html`<p class="small">Note: ${alarm.note}</p>`}
    <${ProblemBox} problem=${problem} />
    ${
      alarm.state !== "closed" &&
      html`<div class="filters">
      <label>Note <input name="note" value=${note} maxlength="500" onInput=${(event) => setNote(event.target.value)} />
        </label>
      ${alarm.state === "open" && html`<button onClick=${acknowledge}>Acknowledge</button>`}
      <button onClick=${() => setClosing(true)}>Close …</button></div>`
    }
    <${Close} open=${closing} note=${note} change=${change} onClose=${() => setClosing(false)} />
  </article>`;
}

function Close({ open, note, change, onClose }) {
  const [anew, setAnew] = useState(false);
  const text = html`The alarm is closed for good. <label class="small"><input type="checkbox" name="new_reference"
    checked=${anew} onChange=${(event) => setAnew(event.target.checked)} />
    the plant is another one from now on: begin f₀ and the charts anew here</label>`;
  return html`<${Confirm} open=${open} title="Close this alarm?" yes="Close it" text=${text} onClose=${onClose}
    work=${() => change({ state: "closed", new_reference: anew, ...(note ? { note } : {}) }, "The alarm is closed.")} />`;
}
