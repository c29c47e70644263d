/**
 * Every plant, a page at a time from the service: state, frequencies, history as a line, alarms; filtered and sorted.
 */
import { html } from "../app/html.js";
import { download, get } from "../app/api.js";
import { ago, counted, digits, moment, percent } from "../app/format.js";
import { useCalm, useLoad, useStream } from "../app/hooks.js";
import { go, requery, to } from "../app/router.js";
import { Choice, Words } from "../parts/filters.js";
import { Live, State } from "../parts/marks.js";
import { Pager } from "../parts/pager.js";
import { Loaded } from "../parts/problem.js";
import { Spark } from "../parts/spark.js";
import { pick } from "./scans.js";

const FILTERS = ["treatment", "tag", "state", "alarm", "severity", "text", "study", "sort", "cursor"];
const LOOK_MS = 3000;
const MOST_FREQUENCIES = 3;

export default function Fleet({ query }) {
  const asked = { ...pick(query, FILTERS), limit: 50 };
  const page = useLoad((signal) => get("/v1/plants", asked, signal), [JSON.stringify(asked)]);
  const facets = useLoad((signal) => get("/v1/fleet", {}, signal), []);
  const refresh = useCalm(() => {
    page.reload();
    facets.reload();
  }, LOOK_MS);
  const live = useStream("/v1/events", refresh, refresh);
  return html`
    <div class="head"><h1>Plants</h1><${Live} state=${live} /></div>
    ${facets.value && html`<${Totals} facets=${facets.value} />`}
    <${Filters} query=${query} facets=${facets.value} />
    <${Loaded} state=${page}>${(found) => html`<${Table} page=${found} sort=${query.get("sort") ?? "id"} /><${Pager}
      next=${found.next_cursor} />`}<//>
    <${Exports} query=${query} />
  `;
}

function Totals({ facets }) {
  const states = Object.entries(facets.states ?? {}).filter(([, count]) => count);
  return html`<div class="numbers">
    <div><b>${facets.plants.toLocaleString()}</b> ${facets.plants === 1 ? "plant" : "plants"}</div>
    <div><b><a href=${to(["alarms"])}>${facets.alarms}</a></b> ${facets.alarms === 1 ? "alarm" : "alarms"}</div>
    ${states.map(([state, count]) => html`<div><b>${count}</b> <${State} of=${state}
      word=${state === "none" ? "never scanned" : state} /></div>`)}
  </div>`;
}

const optionsOf = (counts) =>
  Object.entries(counts ?? {}).map(([value, count]) => ({ value, text: `${value} (${count})` }));

function Filters({ query, facets }) {
  return html`<div class="filters" role="search">
    <${Words} label="Name, place, species" name="text" query=${query} />
    <${Choice} label="Treatment" name="treatment" query=${query} options=${optionsOf(facets?.treatments)} />
    <${Choice} label="Tag" name="tag" query=${query} options=${optionsOf(facets?.tags)} />
    <${Choice} label="Last scan" name="state" query=${query} options=${optionsOf(facets?.states)} />
    <${Choice} label="Alarms" name="alarm" query=${query} options=${[
      { value: "true", text: "with alarms" },
      { value: "false", text: "without" },
    ]} />
    ${Object.keys(facets?.studies ?? {}).length > 1 && html`<${Choice} label="Study" name="study" query=${query}
      options=${optionsOf(facets.studies)} />`}
  </div>`;
}

const COLUMNS = [
  ["id", "Plant"],
  ["treatment", "Treatment", "aside"],
  ["last_scan", "Last scan", "aside"],
  ["frequency", "Frequencies (Hz)", "aside"],
  ["ratio", "f/f₀"],
  ["", "History"],
  ["alarms", "Alarms"],
];

function Table({ page, sort }) {
  if (!page.items.length)
    return html`<p class="wait">No plant here. A scan whose specification names a plant makes one.</p>`;
  return html`<div class="scroll"><table class="plants">
    <caption class="hidden-label">${counted(page.items.length, "plant")} on this page</caption>
    <thead><tr>${COLUMNS.map(([key, label, look]) => html`<${Heading} name=${key} label=${label} look=${look} sort=${sort} />`)}</tr>
      </thead>
    <tbody>${page.items.map((plant) => html`<${Row} key=${plant.id} plant=${plant} />`)}</tbody>
  </table></div>`;
}

/** A column's head; pressing it sorts, pressing it again turns the order round. */
function Heading({ name, label, look, sort }) {
  if (!name) return html`<th scope="col">${label}</th>`;
  const up = sort === name;
  const down = sort === `-${name}`;
  const turn = () => requery({ sort: up ? `-${name}` : name, cursor: "", trail: "" });
  return html`<th scope="col" class=${look} aria-sort=${up ? "ascending" : down ? "descending" : "none"}><button onClick=${turn}>
    ${label} <span aria-hidden="true">${up ? "↑" : down ? "↓" : ""}</span></button></th>`;
}

function Row({ plant }) {
  const more = plant.frequencies.length - MOST_FREQUENCIES;
  const open = (event) => event.target.closest("a") || go(to(["plants", plant.id]));
  return html`<tr onClick=${open} data-plant=${plant.id}>
    <td><a href=${to(["plants", plant.id])}>${plant.name || plant.id}</a><br /><span class="small">
      ${[plant.name && plant.id, plant.position].filter(Boolean).join(" · ")}</span>
      <span class="small only-small">${[plant.treatment, plant.last_scan?.status === "failed" && "last scan failed"]
        .filter(Boolean)
        .join(" · ")}</span></td>
    <td class="aside">${plant.treatment} ${plant.tags.map((tag) => html`<span class="tag">${tag}</span>`)}</td>
    <td class="aside">${
      plant.last_scan
        ? html`<a href=${to(["scans", plant.last_scan.id])}><${State} of=${plant.last_scan.status} /></a><br /><time
          class="small" datetime=${plant.last_scan.at} title=${moment(plant.last_scan.at)}>${ago(plant.last_scan.at)}
          </time>`
        : html`<span class="soft">never scanned</span>`
    }</td>
    <td class="aside">${plant.frequencies.slice(0, MOST_FREQUENCIES).map((one) => html`<span class=${one.doubtful ? "soft" : ""}
      title=${one.name}>${digits(one.frequency_hz)}${one.doubtful ? "?" : ""}</span> `)}${more > 0 ? html`<span
      class="small">+${more}</span>` : ""}</td>
    <td class="number">${plant.ratio == null ? "–" : percent(plant.ratio, 1)}</td>
    <td><${Spark} points=${plant.spark} label=${sparkWords(plant)} /></td>
    <td>${plant.alarms ? html`<a href=${to(["alarms"], { plant: plant.id })}><${State} of=${plant.worst ?? "open"}
      word=${`${plant.alarms} ${plant.worst ?? ""}`} /></a>` : ""}
      ${plant.missed_scans ? html`<br /><${State} of="missed" word=${`${plant.missed_scans} missed`} />` : ""}</td>
  </tr>`;
}

function sparkWords(plant) {
  if (plant.spark.length < 2) return "no history";
  return `f/f0 over ${counted(plant.spark.length, "scan")}: from ${percent(plant.spark[0][1], 1)} to ${percent(plant.spark.at(-1)[1], 1)}`;
}

export function Exports({ query, plant }) {
  const chosen = { study: query?.get("study") ?? "", plant: plant ?? "" };
  const words = (more) => new URLSearchParams(Object.entries({ ...more, ...chosen }).filter(([, value]) => value));
  const save = (format) => download(`/v1/exports/observations?${words({ format })}`, `observations.${format}`);
  return html`<section aria-label="Export"><h2>Export</h2><div class="buttons">
    <button onClick=${() => save("csv")}>Observations (.csv)</button><button
      onClick=${() => save("parquet")}>Observations (.parquet)</button>
    ${!plant && html`<button
      onClick=${() => download(`/v1/exports/ro-crate?${words({})}`, "ro-crate.zip")}>Everything as RO-Crate (.zip)</button>`}
  </div><p class="small">One row for each plant, scan, track and trait, ready for a mixed model.</p></section>`;
}
