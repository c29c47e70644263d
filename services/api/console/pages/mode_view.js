/**
 * One mode swinging on the cloud of frame 0: how far and how fast is the reader's choice, and how much that magnifies
 * and slows is said.
 */
import { html, useEffect, useState } from "../app/html.js";
import { download } from "../app/api.js";
import { measured, number, percent } from "../app/format.js";
import { ProblemBox } from "../parts/problem.js";
import { Reasons } from "../parts/reasons.js";
import { motionAt } from "../space/attach.js";
import { fetchCloud } from "../space/points.js";
import { fetchShape } from "../space/shape.js";
import { Space } from "../space/view.js";
import { fileAddress } from "./scan_files.js";

const MOST = 100_000;
const GREY = 150;
const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

export function ModeView({ scan, entry }) {
  const [cloud, setCloud] = useState(undefined);
  const [shown, setShown] = useState(null);
  const [problem, setProblem] = useState(null);
  const [settings, setSettings] = useState({ on: !calm(), amplitude: 0.08, period: 2, tint: 0 });
  useEffect(() => {
    const abort = new AbortController();
    fetchCloud(scan.id, 0, MOST, abort.signal).then(
      (found) => setCloud(found && { ...found, key: scan.id }),
      (error) => error.name === "AbortError" || setProblem(error),
    );
    return () => abort.abort();
  }, [scan.id, scan.generation]);
  useEffect(() => {
    if (cloud === undefined || !entry.mode.shape) return undefined;
    const abort = new AbortController();
    setProblem(null);
    fetchShape(scan.id, entry.mode.shape, abort.signal).then(
      (shape) => setShown(onCloud(cloud, shape, entry.key)),
      (error) => error.name === "AbortError" || setProblem(error),
    );
    return () => abort.abort();
  }, [cloud, entry.key]);
  const change = (changes) => setSettings((old) => ({ ...old, ...changes }));
  return html`<section aria-label="The chosen mode">
    <${Space} cloud=${shown?.cloud} motion=${shown?.motion} settings=${settings}
      label=${`Mode ${entry.key} at ${number(entry.mode.natural_frequency_hz)} Hz, swinging`} />
    <${Controls} entry=${entry} settings=${settings} extent=${shown?.extent} onChange=${change} />
    <${ProblemBox} problem=${problem} />
    <${Facts} scan=${scan} entry=${entry} />
  </section>`;
}

/** The mode on the cloud; where there is no cloud, on its own sensors. */
function onCloud(cloud, shape, key) {
  if (cloud)
    return {
      cloud,
      motion: motionAt(cloud.positions, shape.positions, shape.motion),
      extent: extentOf(cloud.positions),
    };
  const colours = new Uint8Array(shape.positions.length).fill(GREY);
  return {
    cloud: { positions: shape.positions, colours, key },
    motion: shape.motion,
    extent: extentOf(shape.positions),
  };
}

function extentOf(positions) {
  const [low, high] = [
    [Infinity, Infinity, Infinity],
    [-Infinity, -Infinity, -Infinity],
  ];
  for (let k = 0; k < positions.length; k++) {
    low[k % 3] = Math.min(low[k % 3], positions[k]);
    high[k % 3] = Math.max(high[k % 3], positions[k]);
  }
  return Math.hypot(...high.map((value, axis) => value - low[axis]));
}

function Controls({ entry, settings, extent, onChange }) {
  const slower = settings.period * entry.mode.natural_frequency_hz;
  const larger = extent && entry.mode.amplitude_m ? (settings.amplitude * extent) / entry.mode.amplitude_m : null;
  return html`<div class="controls">
    <button aria-pressed=${settings.on} onClick=${() => onChange({ on: !settings.on })}>
      ${settings.on ? "■ Stop" : "▶ Play"}</button>
    <label>Amplitude${larger ? `: ${number(larger, 2)} times that measured` : ""}
      <input type="range" name="amplitude" min="0" max="0.3" step="0.005" value=${settings.amplitude}
        onInput=${(event) => onChange({ amplitude: Number(event.target.value) })} /></label>
    <label>Speed: ${slower >= 1 ? `${number(slower, 2)} times slower` : `${number(1 / slower, 2)} times faster`}
      <input type="range" name="speed" min="-1.5" max="1.5" step="0.05" value=${-Math.log2(settings.period / 2)}
        onInput=${(event) => onChange({ period: 2 * 2 ** -Number(event.target.value) })} /></label>
    <label class="row"><input type="checkbox" name="tint" checked=${settings.tint === 1}
      onChange=${(event) => onChange({ tint: event.target.checked ? 1 : 0 })} /> colour by displacement</label>
  </div>`;
}

function Facts({ scan, entry }) {
  const mode = entry.mode;
  const stem = mode.shape?.replace(/\.npz$/, "");
  const rows = [
    ["Natural frequency", `${measured(mode.natural_frequency_hz, mode.natural_frequency_hz_std)} Hz`],
    [
      "Damped frequency",
      mode.damped_frequency_hz && `${measured(mode.damped_frequency_hz, mode.damped_frequency_hz_std)} Hz`,
    ],
    ["Damping ratio", `${measured(mode.damping_ratio, mode.damping_ratio_std, 100)} %`],
    ["Largest displacement", mode.amplitude_m && `${number(1000 * mode.amplitude_m, 3)} mm`],
    ["Share of the energy", mode.energy_share != null && percent(mode.energy_share, 1)],
    ["Phase collinearity (MPC)", mode.mpc != null && number(mode.mpc, 4)],
    ["MAC between methods", mode.mac_between_methods != null && number(mode.mac_between_methods, 4)],
    [
      "Organs",
      entry.organ === "structure" && mode.organs.map((one) => `${one.name} (${number(one.amplitude, 2)})`).join(", "),
    ],
  ].filter(([, value]) => value);
  const save = (suffix) => download(fileAddress(scan.id, `${stem}.${suffix}`), `${stem.split("/").at(-1)}.${suffix}`);
  return html`<div class="card">
    <dl class="facts">${rows.map(([name, value]) => html`<dt>${name}</dt><dd>${value}</dd>`)}
      <dt>Verdict</dt><dd>${mode.verdict}<${Reasons} codes=${mode.reasons} /></dd></dl>
    ${
      entry.organ !== "structure" &&
      stem &&
      html`<div class="buttons">
      <button onClick=${() => save("glb")}>Animation (.glb)</button><button
        onClick=${() => save("npz")}>Shape (.npz)</button><button onClick=${() => save("vtp")}>ParaView (.vtp)</button>
        </div>`
    }
  </div>`;
}
