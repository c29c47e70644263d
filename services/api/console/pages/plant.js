/**
 * One plant over weeks: its tracks with error bars, the environment, events, alarms, and its treatment among others.
 */
import { html } from "../app/html.js";
import { get } from "../app/api.js";
import { ago, counted, measured, percent } from "../app/format.js";
import { useCalm, useLoad, useStream } from "../app/hooks.js";
import { to } from "../app/router.js";
import { State } from "../parts/marks.js";
import { Loaded } from "../parts/problem.js";
import { Tabs } from "../parts/tabs.js";
import { AlarmCard } from "./alarms.js";
import { Exports } from "./fleet.js";
import { Drift } from "./plant_drift.js";
import { Environment } from "./plant_environment.js";
import { History } from "./plant_history.js";
import { Tracks } from "./plant_tracks.js";
import { Treatments } from "./treatments.js";
import { Table as ScanTable } from "./scans.js";

const LOOK_MS = 3000;
const PARTS = [
  ["history", "History"],
  ["tracks", "Tracks"],
  ["drift", "Drift"],
  ["environment", "Environment"],
  ["treatments", "Treatments"],
  ["scans", "Scans"],
];

export default function Plant({ id, rest, query }) {
  const path = `/v1/plants/${encodeURIComponent(id)}`;
  const plant = useLoad((signal) => get(path, {}, signal), [id]);
  const story = useLoad((signal) => get(`${path}/history`, { max_points: 500 }, signal), [id]);
  const reload = () => {
    plant.reload();
    story.reload();
  };
  const refresh = useCalm(reload, LOOK_MS);
  useStream("/v1/events", refresh, refresh);
  const part = rest[0] ?? "history";
  return html`<${Loaded} state=${plant}>${(one) => html`
    <${Head} plant=${one} />
    <${Tabs} label="Parts of the plant" current=${part}
      tabs=${PARTS.map(([key, label]) => [key, label, to(["plants", id, key])])} />
    <${Loaded} state=${story}>${(found) => html`<${Part} part=${part} plant=${one} story=${found} path=${path}
      query=${query} onChange=${reload} />`}<//>
  `}<//>`;
}

function Head({ plant }) {
  const facts = [
    plant.species,
    plant.genotype,
    plant.position && `place ${plant.position}`,
    plant.treatment && `treatment ${plant.treatment}`,
    plant.study && `study ${plant.study}`,
  ].filter(Boolean);
  return html`
    <div class="head"><h1>${plant.name || plant.id}</h1><span>${plant.last_scan && html`<a
      href=${to(["scans", plant.last_scan.id])}><${State} of=${plant.last_scan.status}
      word=${`last scan ${plant.last_scan.status}`} /></a>`}</span></div>
    <p class="small">${plant.id} · ${facts.join(" · ")} · ${counted(plant.scans, "scan")}${plant.last_scan ? `, the last ${ago(plant.last_scan.at)}` : ""}
      ${plant.missed_scans ? ` · ${plant.missed_scans} missed` : ""} ${plant.tags.map((tag) => html`<span class="tag">
        ${tag}</span>`)}</p>
    <div class="numbers">
      <div><b>${plant.ratio == null ? "–" : percent(plant.ratio, 1)}</b> f/f₀</div>
      ${plant.frequencies.slice(0, 4).map((one) => html`<div><b>${measured(one.frequency_hz, one.frequency_std_hz)}
        </b> Hz · ${one.name}</div>`)}
      <div><b>${plant.alarms}</b> ${plant.alarms === 1 ? "alarm" : "alarms"} ${plant.worst && html`<${State}
        of=${plant.worst} />`}</div>
    </div>
    <div class="buttons"><a href=${to(["new"], { plant: plant.id })}>New scan of this plant</a></div>`;
}

function Part({ part, plant, story, path, query, onChange }) {
  if (part === "tracks") return html`<${Tracks} story=${story} query=${query} onChange=${onChange} />`;
  if (part === "drift") return html`<${Drift} story=${story} />`;
  if (part === "environment") return html`<${Environment} story=${story} path=${path} onChange=${onChange} />`;
  if (part === "treatments") return html`<${Treatments} study=${plant.study} mine=${plant.treatment} />`;
  if (part === "scans") return html`<${Scans} id=${plant.id} />`;
  return html`
    ${story.alarms.filter((one) => one.state !== "closed").map((one) => html`<${AlarmCard} key=${one.id} alarm=${one}
      onChange=${onChange} />`)}
    <${History} story=${story} />
    <${Exports} plant=${plant.id} />`;
}

function Scans({ id }) {
  const state = useLoad((signal) => get("/v1/scans", { plant: id, limit: 100 }, signal), [id]);
  return html`<${Loaded} state=${state}>${(page) => html`<${ScanTable} page=${page} />${page.next_cursor && html`<p><a
    href=${to(["scans"], { plant: id })}>All of them</a></p>`}`}<//>`;
}
