/**
 * A refusal as the reader needs it: what, what to do, and the id to quote.
 */
import { html } from "../app/html.js";

export function ProblemBox({ problem, onRetry }) {
  if (!problem) return null;
  const others = problem.errors?.length > 1 ? problem.errors : [];
  return html`<div class="problem" role="alert">
    <strong>${problem.detail ?? problem.message}</strong>
    ${problem.hint && html`<p>${problem.hint}</p>`}
    ${others.length > 0 && html`<ul>${others.map((one) => html`<li><code>${one.pointer}</code> ${one.detail} ${one.hint}
      </li>`)}</ul>`}
    <p class="small">
      ${problem.code && html`<code>${problem.code}</code>`}
      ${problem.requestId && html` · request <code>${problem.requestId}</code>`}
      ${onRetry && html` <button onClick=${onRetry}>Try again</button>`}
    </p>
  </div>`;
}

/** The value once it is there; before it, that it is on its way, or why it is not coming. */
export function Loaded({ state, children }) {
  return html`
    <${ProblemBox} problem=${state.problem} onRetry=${state.reload} />
    ${state.value !== null ? children(state.value) : state.loading && html`<p class="wait" role="status">Loading …</p>`}
  `;
}
