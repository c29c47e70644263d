/**
 * The steps of a scan by kind: done of total, what runs, what failed; each kind opens to its single steps.
 */
import { html, useState } from "../app/html.js";
import { get } from "../app/api.js";
import { duration, number, percent } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { stepName } from "../app/words.js";
import { Bar, State } from "../parts/marks.js";
import { Loaded } from "../parts/problem.js";

export function Steps({ scan, ticks }) {
  const [open, setOpen] = useState("");
  return html`<div class="scroll"><table class="steps">
    <caption class="hidden-label">Steps of the scan</caption>
    <thead><tr><th scope="col">Step</th><th scope="col">Progress</th><th scope="col" class="number">Done</th>
      <th scope="col" class="number">Running</th><th scope="col" class="number">Failed</th><th></th></tr></thead>
    <tbody>${scan.progress.map(
      (row) => html`
      <tr key=${row.step} data-step=${row.step}>
        <th scope="row">${stepName(row.step)}</th>
        <td class="bar"><${Bar} fraction=${row.fraction} label=${stepName(row.step)} /> <span class="small">
          ${percent(row.fraction)}</span></td>
        <td class="number">${row.done} / ${row.total}</td>
        <td class="number">${row.running || ""}</td>
        <td class="number">${row.failed ? html`<${State} of="failed" word=${row.failed} />` : ""}</td>
        <td><button class="plain" aria-expanded=${open === row.step}
          onClick=${() => setOpen(open === row.step ? "" : row.step)}>
          ${open === row.step ? "close" : "details"}<span class="hidden-label"> of ${stepName(row.step)}</span></button>
            </td>
      </tr>
      ${open === row.step && html`<tr><td colspan="6"><${Single} scan=${scan} kind=${row.step} ticks=${ticks} /></td>
        </tr>`}`,
    )}
    </tbody>
  </table></div>`;
}

function Single({ scan, kind, ticks }) {
  const [onlyFailed, setOnlyFailed] = useState(false);
  const asked = { step: kind, limit: 100, ...(onlyFailed ? { state: "failed" } : {}) };
  const state = useLoad(
    (signal) => get(`/v1/scans/${scan.id}/steps`, asked, signal),
    [kind, onlyFailed, scan.generation],
    [ticks],
  );
  return html`
    <label class="small"><input type="checkbox" checked=${onlyFailed}
      onChange=${(event) => setOnlyFailed(event.target.checked)} /> failed only</label>
    <${Loaded} state=${state}>${(page) => html`
      <div class="scroll"><table>
        <thead><tr><th scope="col">Frame</th><th scope="col">State</th><th scope="col" class="number">Attempt</th>
          <th scope="col" class="number">Took</th><th scope="col">What it says</th></tr></thead>
        <tbody>${page.items.map(
          (step) => html`<tr key=${step.id}>
          <td>${step.frame < 0 ? "whole scan" : step.frame}</td>
          <td><${State} of=${step.state} /></td>
          <td class="number">${step.attempt || ""}</td>
          <td class="number">${took(step)}</td>
          <td>${step.error ? html`<strong>${step.error.message}</strong> ${step.error.hint} <code>${step.error.code}
            </code>` : said(step)}</td>
        </tr>`,
        )}</tbody>
      </table></div>
      ${page.next_cursor && html`<p class="small">The first 100 of them.</p>`}`}
    <//>`;
}

const took = (step) =>
  step.started_at && step.finished_at ? duration((new Date(step.finished_at) - new Date(step.started_at)) / 1000) : "";

function said(step) {
  if (step.state === "running") return `${step.done} of ${step.total || "?"} ${step.message}`;
  const facts = Object.entries(step.facts ?? {}).filter(([, value]) => typeof value !== "object");
  return facts
    .map(([key, value]) => `${key.replaceAll("_", " ")} ${typeof value === "number" ? number(value) : value}`)
    .join(", ");
}
