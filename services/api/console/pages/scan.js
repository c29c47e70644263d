/**
 * One scan: what it is, how far it is, and its parts as tabs. Everything follows the scan's own stream of events.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { get } from "../app/api.js";
import { ago, duration, moment, percent } from "../app/format.js";
import { useCalm, useLoad, useStream } from "../app/hooks.js";
import { to } from "../app/router.js";
import { Later } from "../parts/later.js";
import { Bar, Live, State, overall } from "../parts/marks.js";
import { Loaded } from "../parts/problem.js";
import { Tabs } from "../parts/tabs.js";
import { tell } from "../parts/told.js";
import { Actions } from "./scan_actions.js";
import { Modes } from "./scan_modes.js";
import { Steps } from "./scan_steps.js";

const LOOK_MS = 400;
const PARTS = {
  steps: { label: "Steps", View: Steps },
  modes: { label: "Modes", View: Modes },
  signals: { label: "Signals", file: "scan_signals", name: "Signals" },
  pictures: { label: "Pictures", file: "scan_pictures", name: "Pictures" },
  cloud: { label: "Point cloud", file: "scan_cloud", name: "Cloud" },
  logs: { label: "Logs", file: "scan_logs", name: "Logs" },
  files: { label: "Files", file: "scan_files", name: "Files" },
};

export default function Scan({ id, rest, query }) {
  const state = useLoad((signal) => get(`/v1/scans/${id}`, {}, signal), [id]);
  const [progress, setProgress] = useState(null);
  const [ticks, setTicks] = useState(0);
  const refresh = useCalm(() => {
    setProgress(null);
    state.reload();
    setTicks((old) => old + 1);
  }, LOOK_MS);
  const onEvent = (type, data) => {
    if (type === "progress") setProgress(data.progress);
    else refresh();
  };
  const live = useStream(state.value && `/v1/scans/${id}/events?after=now`, onEvent, refresh, true);
  return html`<${Loaded} state=${state}>${(scan) => html`
    <${View} scan=${{ ...scan, progress: progress ?? scan.progress }} live=${live} ticks=${ticks}
      part=${rest[0] ?? (scan.status === "succeeded" ? "modes" : "steps")} query=${query} onChange=${refresh} />`}
  <//>`;
}

function View({ scan, live, ticks, part, query, onChange }) {
  const before = useRef("");
  useEffect(() => {
    document.title = `${scan.name} · ${scan.status} · nerfmodal`;
    if (before.current && before.current !== scan.status) tell(`The scan is ${scan.status}.`);
    before.current = scan.status;
  }, [scan.name, scan.status]);
  const done = overall(scan.progress);
  const going = !scan.finished_at;
  return html`
    <div class="head">
      <h1>${scan.name}</h1>
      <span><${State} of=${scan.status} word=${scan.state} /> <${Live} state=${live} /></span>
    </div>
    <p class="small">
      ${scan.plant && html`plant <a href=${to(["plants", scan.plant])}>${scan.plant}</a> · `}
      ${scan.source} · submitted <time datetime=${scan.created_at} title=${moment(scan.created_at)}>
        ${ago(scan.created_at)}</time>
      ${scan.finished_at && scan.started_at && html` · took ${duration((new Date(scan.finished_at) - new Date(scan.started_at)) / 1000)}`}
      ${scan.generation > 0 && html` · run ${scan.generation + 1} times`}
      ${" "}${scan.tags.map((tag) => html`<span class="tag">${tag}</span>`)}
    </p>
    ${
      going &&
      html`<p><${Bar} fraction=${done} label="Progress of the scan" />
      <span class="small">${percent(done)} done${scan.eta_s != null ? `, about ${duration(scan.eta_s)} left` : ""}
        </span></p>`
    }
    ${scan.error && html`<${Failure} error=${scan.error} />`}
    <${Actions} scan=${scan} onChange=${onChange} />
    <${Tabs} label="Parts of the scan" current=${part}
      tabs=${Object.entries(PARTS).map(([key, one]) => [key, one.label, to(["scans", scan.id, key])])} />
    <${Part} key=${part} part=${part} scan=${scan} ticks=${ticks} query=${query} />
  `;
}

function Failure({ error }) {
  return html`<div class="problem" role="alert">
    <strong>${error.message}</strong>
    ${error.hint && html`<p>${error.hint}</p>`}
    <p class="small"><code>${error.code}</code> ${error.step && html`in ${error.step}`}</p>
  </div>`;
}

/** The steps and the modes come with the page, the other parts when they are asked for. */
function Part({ part, ...rest }) {
  const { View, file, name } = PARTS[part] ?? PARTS.steps;
  return View ? html`<${View} ...${rest} />` : html`<${Later} file=${file} name=${name} ...${rest} />`;
}
