/**
 * What an organ's modes are read from: histories and spectra of the modal coordinates, stabilisation diagram,
 * eigenvalues. The numbers are those of the report's pictures (figures/ORGAN.json).
 */
import { html } from "../app/html.js";
import { get, send } from "../app/api.js";
import { measured, percent } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { requery } from "../app/router.js";
import { Chart, HUES, SHAPES } from "../parts/chart.js";
import { Loaded } from "../parts/problem.js";
import { fileAddress } from "./scan_files.js";

const DECADES = 6;
const LONG = 300; // frames; beyond them points are ink

export function Signals({ scan, ticks, query }) {
  const state = useLoad((signal) => get(`/v1/scans/${scan.id}/modes`, {}, signal), [scan.id], [scan.status, ticks]);
  if (state.problem?.status === 404) return html`<p class="wait">The modes are not identified yet.</p>`;
  return html`<${Loaded} state=${state}>${(document) => {
    const organs = document.organs;
    const organ = organs.find((one) => one.name === query.get("organ")) ?? organs[0];
    return organ
      ? html`<${Organ} scan=${scan} organs=${organs} organ=${organ} />`
      : html`<p class="wait">No organ was found.</p>`;
  }}<//>`;
}

function Organ({ scan, organs, organ }) {
  const state = useLoad(
    async (signal) => (await send(fileAddress(scan.id, `figures/${organ.name}.json`), { signal })).json(),
    [scan.id, scan.generation, organ.name],
  );
  return html`
    <div class="controls"><label>Organ <select name="organ" value=${organ.name}
      onChange=${(event) => requery({ organ: event.target.value })}>
      ${organs.map((one) => html`<option value=${one.name} selected=${one.name === organ.name}>${one.name}</option>`)}
    </select></label><span class="small">Drag over a chart to look closer, double click to undo it.</span></div>
    ${
      state.problem?.status === 404
        ? html`<p class="wait">This result was written without the numbers of its pictures; the report has them as pictures.</p>`
        : html`<${Loaded} state=${state}>${(numbers) => html`<${Numbers} organ=${organ} numbers=${numbers} />`}<//>`
    }
  `;
}

function Numbers({ organ, numbers }) {
  if (!numbers.coordinates_mm.length)
    return html`<p class="wait">${organ.message}</p><${Eigenvalues} of=${numbers.eigenvalues} />`;
  return html`
    <h2>Modal coordinates</h2>
    ${organ.modes.map(
      (mode, k) => html`<div class="two" key=${`${organ.name} ${k}`}>
      <${Chart} title=${`Mode ${k}: ${measured(mode.natural_frequency_hz, mode.natural_frequency_hz_std)} Hz, damping ${measured(mode.damping_ratio, mode.damping_ratio_std, 100)} %, ${mode.verdict}`}
        x=${numbers.times_s} xLabel="time (s)" yLabel="mm" height=${170}
        series=${[{ label: "displacement", y: numbers.coordinates_mm[k], points: numbers.times_s.length <= LONG, size: 4 }]} />
      <${Spectrum} mode=${mode} k=${k} numbers=${numbers} />
    </div>`,
    )}
    <div class="two">
      <${Stabilisation} organ=${organ} numbers=${numbers} />
      <${Eigenvalues} of=${numbers.eigenvalues} />
    </div>
  `;
}

const markOf = (mode) => ({
  x: mode.natural_frequency_hz,
  label: `mode ${mode.mode} at ${mode.natural_frequency_hz.toFixed(3)} Hz`,
  hue: "vermillion",
  dash: mode.verdict === "accepted" ? [] : [4, 3],
  width_x: 1.96 * (mode.natural_frequency_hz_std ?? 0),
});

function floored(values) {
  const peak = Math.max(...values.filter((value) => value != null));
  return { peak, values: values.map((value) => (value == null ? null : Math.max(value, peak * 10 ** -DECADES))) };
}

function Spectrum({ mode, k, numbers }) {
  const density = numbers.densities_mm2_per_hz[k];
  if (!density.length) return null;
  const { peak, values } = floored(density);
  return html`<${Chart} title="Power spectral density; the band is the 95 % interval" x=${numbers.frequencies_hz}
    xLabel="frequency (Hz)" yLabel="mm²/Hz"
    log height=${170} yRange=${[peak * 10 ** -DECADES, peak * 4]} marks=${[markOf(mode)]}
      series=${[{ label: "density", y: values, points: false }]} />`;
}

function Stabilisation({ organ, numbers }) {
  const poles = numbers.stabilisation;
  if (!poles)
    return html`<div><h2>Stabilisation diagram</h2><p
      class="small">No method of this record reads its modes from models of rising order (a free decay is fitted as a whole).</p>
      </div>`;
  const order = poles.frequencies_hz.map((_, k) => k).sort((a, b) => poles.frequencies_hz[a] - poles.frequencies_hz[b]);
  const only = (stable) => order.map((k) => (poles.stable[k] === stable ? poles.orders[k] : null));
  return html`<div><h2>Stabilisation diagram</h2><${Chart}
    title="Poles of models of rising order; upright lines are the identified modes"
    x=${order.map((k) => poles.frequencies_hz[k])} xLabel="frequency (Hz)" yLabel="model order" height=${300}
    xRange=${[0, numbers.frame_rate_hz / 2]} yRange=${[0, Math.max(...poles.orders) + 2]}
      marks=${organ.modes.map(markOf)}
    series=${[
      { label: "stable", y: only(true), line: false, hue: HUES[0], shape: SHAPES[0], size: 6 },
      { label: "not stable", y: only(false), line: false, hue: "grey", shape: "cross", size: 5 },
    ]} /></div>`;
}

function Eigenvalues({ of }) {
  if (!of) return null;
  const values = of.mean_squares_mm2.map((value) => Math.max(value, of.mean_squares_mm2[0] * 1e-12));
  const share = of.mean_squares_mm2.slice(0, of.kept).reduce((sum, value) => sum + value, 0) / of.sum_mm2;
  const side = (kept) => values.map((value, k) => (k < of.kept === kept ? value : null));
  return html`<div><h2>Eigenvalues</h2><${Chart}
    title=${`${of.kept} components kept: ${percent(share, 2)} of the energy`}
    x=${values.map((_, k) => k + 1)} xLabel="component" yLabel="mean square (mm²)" log height=${300}
    series=${[
      { label: "kept", y: side(true), line: false, hue: "blue", size: 8 },
      { label: "left out", y: side(false), line: false, hue: "grey", shape: "ring", size: 6 },
    ]} /></div>`;
}
