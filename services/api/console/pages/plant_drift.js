/**
 * Control charts with their limits, what the environment explains, change points and trends.
 */
import { html } from "../app/html.js";
import { day, measured, number, percent } from "../app/format.js";
import { inWords } from "../app/words.js";
import { Chart } from "../parts/chart.js";
import { seconds } from "./plant_history.js";

const NAMES = {
  ewma: "Moving average (EWMA)",
  cusum_up: "Sum of rises (CUSUM)",
  cusum_down: "Sum of falls (CUSUM)",
  t2: "All modes together (Hotelling's T²)",
};

export function Drift({ story }) {
  const { drift } = story;
  const nameOf = (track) => story.tracks.find((one) => one.id === track)?.name ?? "all tracks";
  if (!drift?.charts?.length)
    return html`<p class="wait">Control charts begin once there are enough scans for a reference.</p>`;
  return html`
    <p class="small">Reference: ${drift.reference.scans} scans from ${day(drift.reference.from)} to ${day(drift.reference.until)}. ${drift.covariates?.length ? `What ${drift.covariates.map(inWords).join(", ")} ${drift.covariates.length === 1 ? "explains" : "explain"} is taken off before.` : "Nothing of the environment is taken off."}
      </p>
    <p class="small">Diamonds are signals: values beyond the dashed limits.</p>
    <div class="two">${drift.charts.map((one, k) => html`<${Control} key=${k} chart=${one}
      name=${nameOf(one.track)} />`)}</div>
    <${Findings} drift=${drift} nameOf=${nameOf} />`;
}

function Control({ chart, name }) {
  const x = chart.at.map(seconds);
  const side = (signal) => chart.value.map((value, k) => (chart.signal[k] === signal ? value : null));
  const limits = [chart.limit, chart.chart === "ewma" ? 2 * (chart.center ?? 0) - chart.limit : null].filter(
    (one) => one != null,
  );
  return html`<${Chart} title=${`${NAMES[chart.chart] ?? chart.chart}, ${name}`} x=${x} time xLabel="" yLabel="σ"
    height=${190} legend=${false}
    levels=${limits.map((y) => ({ y, hue: "vermillion" }))} yRange=${rangeOf([...chart.value, ...limits])}
    series=${[
      { label: "", y: chart.value, hue: "grey", points: false, width: 1 },
      { label: "inside", y: side(false), line: false, hue: "blue" },
      { label: "signal", y: side(true), line: false, hue: "vermillion", shape: "diamond", size: 8 },
    ]} />`;
}

function rangeOf(values) {
  const known = values.filter((value) => value != null);
  const [low, high] = [Math.min(0, ...known), Math.max(...known)];
  const edge = 0.08 * (high - low || 1);
  return [low - edge, high + edge];
}

function Findings({ drift, nameOf }) {
  const rows = [
    ...(drift.change_points ?? []).map((one) => [
      nameOf(one.track),
      "changed",
      `on ${day(one.at)} from ${percent(one.before, 1)} to ${percent(one.after, 1)}`,
    ]),
    ...(drift.trends ?? []).map((one) => [
      nameOf(one.track),
      one.trend,
      `${number(100 * one.per_day, 2)} % a day, p = ${number(one.p_value, 2)}`,
    ]),
    ...(drift.effects ?? []).map((one) => [
      nameOf(one.track),
      `effect of ${one.covariate}`,
      `${measured(one.per_unit, one.std, 100)} % per unit`,
    ]),
  ];
  if (!rows.length) return null;
  return html`<h2>Findings</h2><div class="scroll"><table><thead><tr><th scope="col">Track</th><th scope="col">What</th>
    <th scope="col">How much</th></tr></thead>
    <tbody>${rows.map(([track, what, how]) => html`<tr><td>${track}</td><td>${what}</td><td>${how}</td></tr>`)}</tbody>
      </table></div>`;
}
