/**
 * The modes: numbers with their uncertainty, verdicts with their reasons, the truth of a simulation beside them, and
 * the chosen mode swinging in space.
 */
import { html, useMemo } from "../app/html.js";
import { get } from "../app/api.js";
import { counted, measured, number, percent } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { requery } from "../app/router.js";
import { Later } from "../parts/later.js";
import { State } from "../parts/marks.js";
import { Loaded } from "../parts/problem.js";
import { fetchTruth, pairs } from "./truth.js";

export function Modes({ scan, ticks, query }) {
  const state = useLoad(
    (signal) => get(`/v1/scans/${scan.id}/modes`, {}, signal),
    [scan.id, scan.generation],
    [scan.status, ticks],
  );
  const truth = useLoad(
    async (signal) => (isSimulated(scan) ? fetchTruth(scan, signal) : null),
    [scan.id, scan.generation],
    [scan.status],
  );
  if (state.problem?.status === 404) return html`<p class="wait">The modes are not identified yet.</p>`;
  return html`<${Loaded} state=${state}>${(document) => html`<${Document} scan=${scan} document=${document}
    truth=${truth.value} query=${query} />`}<//>`;
}

/** Whether something was imposed: by the scan itself, or on the clouds that it was made of. */
const isSimulated = (scan) => scan.source === "simulation" || scan.tags.includes("simulated");

function Document({ scan, document, truth, query }) {
  const entries = useMemo(() => entriesOf(document), [document]);
  const chosen =
    entries.find((one) => one.key === query.get("mode")) ??
    entries.find((one) => one.mode.verdict === "accepted") ??
    entries[0];
  const paired = useMemo(() => (truth ? pairs(truth, document.organs) : null), [truth, document]);
  return html`
    ${document.partial && html`<p class="card"
      role="status">The modes so far, from ${document.partial.frames} of ${document.partial.of} frames; more come while the scan runs.</p>`}
    <p class="small">${number(document.duration_s)} s at ${number(document.frame_rate_hz)} Hz · ${document.excitation.replaceAll("_", " ")} · ${summary(entries)} ${document.outcome !== "OK" ? html`<strong>
      ${document.message}</strong>` : ""}</p>
    ${
      chosen &&
      html`<div class="side">
      <div>
        <${Table} entries=${entries} chosen=${chosen} paired=${paired} />
        <${Missed} paired=${paired} />
      </div>
      <${Later} file="mode_view" name="ModeView" scan=${scan} entry=${chosen} />
    </div>`
    }
  `;
}

function summary(entries) {
  const count = (verdict) => entries.filter((one) => one.mode.verdict === verdict).length;
  return (
    ["accepted", "doubtful", "rejected"]
      .filter(count)
      .map((verdict) => `${count(verdict)} ${verdict}`)
      .join(", ") || "no modes"
  );
}

/** Modes of all organs, then the motions that organs share. */
function entriesOf(document) {
  const own = document.organs.flatMap((organ) =>
    organ.modes.map((mode) => ({ key: `${organ.name} ${mode.mode}`, organ: organ.name, mode })),
  );
  const shared = document.structure.map((mode) => ({ key: `structure ${mode.mode}`, organ: "structure", mode }));
  return [...own, ...shared];
}

function Table({ entries, chosen, paired }) {
  const choose = (entry) => requery({ mode: entry.key });
  return html`<div class="scroll"><table class="modes">
    <caption class="hidden-label">${counted(entries.length, "mode")}</caption>
    <thead><tr><th scope="col">Mode</th><th scope="col" class="number">Frequency (Hz)</th><th scope="col"
      class="number">Damping (%)</th>
      ${paired && html`<th scope="col" class="number">True (Hz)</th>`}<th scope="col">Verdict</th></tr></thead>
    <tbody>${entries.map(
      (
        entry,
      ) => html`<tr key=${entry.key} aria-selected=${entry.key === chosen.key} data-mode=${entry.key}
        onClick=${() => choose(entry)}>
      <td><button class="plain" aria-pressed=${entry.key === chosen.key} onClick=${() => choose(entry)}>
        ${entry.organ} · ${entry.mode.mode}</button></td>
      <td class="number">${measured(entry.mode.natural_frequency_hz, entry.mode.natural_frequency_hz_std)}</td>
      <td class="number">${measured(entry.mode.damping_ratio, entry.mode.damping_ratio_std, 100)}</td>
      ${paired && html`<td class="number"><${True} one=${paired.matched.get(entry.key)} mode=${entry.mode} /></td>`}
      <td><${State} of=${entry.mode.verdict} /></td></tr>`,
    )}</tbody>
  </table></div>`;
}

function True({ one, mode }) {
  if (!one) return "";
  const off = mode.natural_frequency_hz / one.frequency - 1;
  return html`<span title=${`imposed: ${one.name}, damping ${percent(one.damping, 2)}`}>${number(one.frequency)} <span
    class="soft">(${off >= 0 ? "+" : "−"}${percent(Math.abs(off), 2)})</span></span>`;
}

function Missed({ paired }) {
  if (!paired?.missed.length) return null;
  return html`<p class="small">Imposed but not found: ${paired.missed.map((one) => `${one.organ} ${one.name} at ${number(one.frequency)} Hz`).join(", ")}.</p>`;
}
