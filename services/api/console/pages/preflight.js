/**
 * What the record can and cannot resolve, and what it will cost: asked before anything is computed.
 */
import { html } from "../app/html.js";
import { post } from "../app/api.js";
import { duration, number } from "../app/format.js";
import { stepName } from "../app/words.js";
import { State } from "../parts/marks.js";

const VERDICTS = {
  ok: ["succeeded", "can be resolved"],
  warn: ["warning", "with doubts"],
  refuse: ["failed", "makes no sense so"],
};
const SEVERITIES = { refuse: "failed", warn: "warning", note: "notice" };
const FOUND = { likely: "accepted", uncertain: "doubtful", unlikely: "rejected", unknown: "none" };

/** The answer, or null where this service has no such check. Throws `Problem`. */
export async function askPreflight(spec) {
  try {
    return await post("/v1/preflight", spec);
  } catch (problem) {
    if ([404, 405].includes(problem.status)) return null;
    throw problem;
  }
}

export function Preflight({ answer }) {
  const [state, word] = VERDICTS[answer.verdict];
  const { record, cost } = answer;
  return html`<section class="card" aria-label="Preflight" role="status">
    <h2>Preflight: <${State} of=${state} word=${word} /></h2>
    ${record && html`<p class="small">
      ${number(record.duration_s)} s at ${number(record.frame_rate_hz)} Hz: modes from ${number(record.lowest_hz, 3)} to ${number(record.highest_hz, 3)} Hz, lines ${number(record.bin_width_hz, 2)} Hz wide</p>`}
    ${answer.findings.map((one) => html`<p><${State} of=${SEVERITIES[one.severity]}
      word=${one.severity} /> ${one.message} <span class="soft">${one.hint}</span> ${one.pointer && html`<code>
      ${one.pointer}</code>`}</p>`)}
    <${Lines} lines=${answer.modes.length ? answer.modes : answer.resolves} expected=${answer.modes.length > 0} />
    ${
      cost &&
      html`<p><strong>Cost:</strong> about ${duration(cost.elapsed_s)} on ${cost.slots} slots (${duration(cost.work_s)} of work):
      ${cost.steps.map((one) => `${stepName(one.step)} ${one.count} × ${duration(one.seconds_each)}`).join(", ")}</p>`
    }
  </section>`;
}

function Lines({ lines, expected }) {
  if (!lines.length) return null;
  return html`<div class="scroll"><table>
    <caption class="small">${expected ? "The modes that are there" : "What lines of 1 % damping and ten times the noise would give"}
      </caption>
    <thead><tr><th scope="col">Mode</th><th scope="col" class="number">Frequency (Hz)</th><th scope="col"
      class="number">± (Hz)</th><th scope="col" class="number">Damping ± (%)</th><th scope="col">Found</th></tr></thead>
    <tbody>${lines.map(
      (
        one,
      ) => html`<tr><td>${[one.organ, one.shape].filter(Boolean).join(" ") || "a line"}</td><td class="number">
        ${number(one.frequency_hz)}</td>
      <td class="number">${number(one.frequency_std_hz, 2)}</td><td class="number">
        ${one.damping_std == null ? "–" : number(100 * one.damping_std, 2)}</td>
      <td><${State} of=${FOUND[one.found]} word=${one.found} /></td></tr>`,
    )}</tbody></table></div>`;
}
