/**
 * Scans, the newest first, kept up to date by the events of all scans.
 */
import { html } from "../app/html.js";
import { get } from "../app/api.js";
import { ago, counted, moment, percent } from "../app/format.js";
import { useCalm, useLoad, useStream } from "../app/hooks.js";
import { to } from "../app/router.js";
import { Choice, Words } from "../parts/filters.js";
import { Bar, Live, State, overall } from "../parts/marks.js";
import { Pager } from "../parts/pager.js";
import { Loaded } from "../parts/problem.js";

const STATUSES = ["queued", "running", "succeeded", "failed", "canceled"];
const WORD = "[A-Za-z0-9_.\\-]*";
const LOOK_MS = 1500;

export default function Scans({ query }) {
  const asked = { ...pick(query, ["status", "plant", "tag", "cursor"]), limit: 50 };
  const state = useLoad((signal) => get("/v1/scans", asked, signal), [JSON.stringify(asked)]);
  const reload = useCalm(state.reload, LOOK_MS);
  const live = useStream("/v1/events?steps=true", reload, reload);
  return html`
    <div class="head"><h1>Scans</h1><${Live} state=${live} /></div>
    <div class="filters" role="search">
      <${Choice} label="State" name="status" query=${query} options=${STATUSES} />
      <${Words} label="Plant" name="plant" query=${query} pattern=${WORD} />
      <${Words} label="Tag" name="tag" query=${query} pattern=${WORD} />
      <a href=${to(["new"])}>New scan</a>
    </div>
    <${Loaded} state=${state}>${(page) => html`<${Table} page=${page} /><${Pager} next=${page.next_cursor} />`}<//>
  `;
}

/** The named words of a query that are not empty. */
export function pick(query, names) {
  return Object.fromEntries(names.filter((name) => query.get(name)).map((name) => [name, query.get(name)]));
}

export function Table({ page }) {
  if (!page.items.length) return html`<p class="wait">No scans here. <a href=${to(["new"])}>Start one.</a></p>`;
  return html`<div class="scroll"><table>
    <caption class="hidden-label">${counted(page.items.length, "scan")} on this page</caption>
    <thead><tr><th scope="col">Scan</th><th scope="col">State</th><th scope="col" class="aside">Progress</th><th
      scope="col">Plant</th>
      <th scope="col" class="aside">Source</th><th scope="col" class="aside">Tags</th><th scope="col">Submitted</th></tr></thead>
    <tbody>${page.items.map((scan) => html`<${Row} key=${scan.id} scan=${scan} />`)}</tbody>
  </table></div>`;
}

function Row({ scan }) {
  const done = overall(scan.progress);
  const going = !scan.finished_at;
  return html`<tr>
    <td><a href=${to(["scans", scan.id])}>${scan.name}</a></td>
    <td><${State} of=${scan.status} word=${scan.state} />${going && html` <span class="small only-small">
      ${percent(done)}</span>`}</td>
    <td class="aside">${going && html`<${Bar} fraction=${done}
      label=${`Progress of ${scan.name}`} /> ${percent(done)}`}</td>
    <td>${scan.plant ? html`<a href=${to(["plants", scan.plant])}>${scan.plant}</a>` : ""}</td>
    <td class="aside">${scan.source}</td>
    <td class="aside">${scan.tags.map((tag) => html`<span class="tag">${tag}</span>`)}</td>
    <td><time datetime=${scan.created_at} title=${moment(scan.created_at)}>${ago(scan.created_at)}</time></td>
  </tr>`;
}
